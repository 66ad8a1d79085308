"""Working with a cell: examine its file (`check`), clear its table (`run`)."""
