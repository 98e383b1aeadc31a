from .import_map import ImportMap as ImportMap, read_map as read_map
from .importing import (
    Imported as Imported,
    Source as Source,
    import_source as import_source,
    open_source as open_source,
    write_imported as write_imported,
)
from .settings import ImportSettings as ImportSettings
