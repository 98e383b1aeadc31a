from .base import (
    Motion as Motion,
    MotionSequence as MotionSequence,
    motion_from_dict as motion_from_dict,
    sample as sample,
    sequence as sequence,
)
from .calibration import (
    CALIBRATION as CALIBRATION,
    calibration as calibration,
    motion_i as motion_i,
    motion_ii as motion_ii,
    motion_iii as motion_iii,
    motion_iv as motion_iv,
)
from .limits import MotionLimits as MotionLimits, Peaks as Peaks, check_limits as check_limits
from .multisine import Multisine as Multisine, Tone as Tone, multisine as multisine
from .periodic import Circling as Circling, Straight as Straight, Turning as Turning
from .steps import Steps as Steps, steps as steps
