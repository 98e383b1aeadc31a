from .plant import ContactPlant as ContactPlant
from .settings import Contact as Contact
