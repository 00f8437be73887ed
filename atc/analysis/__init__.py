"""What is made of fields and trajectories: comparison, balance laws, speed against error, conductivity."""


def __getattr__(name):
    # A class of MDAnalysis, which is loaded by those who ask for it.
    if name == "Fields":
        from .universe import Fields

        return Fields
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
