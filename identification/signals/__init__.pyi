from .filters import FILTER_RATE as FILTER_RATE
from .noise import white_noise as white_noise
