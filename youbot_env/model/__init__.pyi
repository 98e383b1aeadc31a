from .model import Estimate as Estimate, Model as Model
from .model_file import (
    load_geometry as load_geometry,
    load_model as load_model,
    save_model as save_model,
    shipped_models as shipped_models,
)
