from .axis import Axis as Axis
from .mecanum import Mecanum as Mecanum
from .mechanism import Mechanism as Mechanism
from .registry import (
    MECHANISMS as MECHANISMS,
    load_any_model as load_any_model,
    mechanism_of as mechanism_of,
    save_any_model as save_any_model,
)
from .settings import MechanismSettings as MechanismSettings
