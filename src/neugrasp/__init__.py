"""NeuGrasp: surfaces and 6-DoF grasps from a few RGB photos of a table."""


def __getattr__(name: str) -> str:
    """`__version__`, read from the installed package when it is asked for."""
    if name == "__version__":
        from importlib import metadata

        return metadata.version("neugrasp")
    raise AttributeError(f"module 'neugrasp' has no attribute {name!r}")
