from .filters import FilterSettings as FilterSettings
from .noise import NoiseSettings as NoiseSettings, white_noise as white_noise
