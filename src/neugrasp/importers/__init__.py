"""Other programs' photos and cameras, as scenes."""
