from .equations import equation as equation, formula as formula
