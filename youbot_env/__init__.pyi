from .contact.plant import ContactPlant as ContactPlant
from .contact.settings import Contact as Contact
from .errors import InputError as InputError
from .exports import (
    linear_control as linear_control,
    step_function as step_function,
    to_c as to_c,
    to_control as to_control,
    to_mjcf as to_mjcf,
    to_torch as to_torch,
)
from .model import (
    Estimate as Estimate,
    Model as Model,
    load_model as load_model,
    save_model as save_model,
    shipped_models as shipped_models,
)
from .motions import multisine as multisine
from .physics.effect import (
    ACTUATOR as ACTUATOR,
    BODY as BODY,
    CHANNEL as CHANNEL,
    CLOCK as CLOCK,
    ROLLER as ROLLER,
    WHEEL as WHEEL,
    WORLD as WORLD,
    Parameter as Parameter,
    Public as Public,
    effect as effect,
)
from .physics.geometry import Geometry as Geometry
from .physics.mecanum import CATALOGUE as CATALOGUE
from .plugins import load_effects as load_effects
from .simulation import Plant as Plant, initial_state as initial_state

__all__: list[str]
__version__: str
