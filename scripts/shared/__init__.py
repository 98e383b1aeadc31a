"""What commands share: options, tables, result folders, the report page."""
