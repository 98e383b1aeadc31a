from .residual_map import residual_map as residual_map
from .settings import ResidualMapSettings as ResidualMapSettings
from .shares import ResidualMap as ResidualMap
