"""Digital twin for air-bearing spacecraft simulators."""

__version__: str


def __getattr__(name: str) -> str:
    # Looking the version up costs more than the rest of `twin --help`.
    if name == "__version__":
        from importlib.metadata import version

        return version("airbearing-twin")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
