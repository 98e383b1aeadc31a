from .tuning import Tuning as Tuning
