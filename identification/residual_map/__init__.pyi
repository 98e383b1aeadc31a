from .residual_map import ResidualMap as ResidualMap, residual_map as residual_map
