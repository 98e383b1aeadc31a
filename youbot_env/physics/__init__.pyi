from .effect import Effect as Effect, Parameter as Parameter, Public as Public, Registry as Registry
from .geometry import Geometry as Geometry
from .inverse_dynamics import (
    forward_dynamics as forward_dynamics,
    mass_matrix as mass_matrix,
    wrench as wrench,
)
from .mechanism import (
    EffectPoints as EffectPoints,
    Instant as Instant,
    MechanismKind as MechanismKind,
    ModelStructure as ModelStructure,
)
