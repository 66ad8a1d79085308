"""Detection over HTTP: cells, photos in, grasps out (docs/server.md)."""
