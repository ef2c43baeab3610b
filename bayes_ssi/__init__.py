"""Identified modes in, ranked model classes out.

Bayesian structural system identification for structures whose non-structural elements may
vibrate on their own and hide in the modal data.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bayes_ssi.api import *  # noqa: F403 - what __getattr__ does, for type checkers


def __getattr__(name: str) -> Any:
    # Imported at first use: scipy takes longer to load than "bayes-ssi --version" may last.
    from importlib import import_module
    from importlib.metadata import version

    if name == "__version__":
        return version(__name__)
    if name == "plots":
        return import_module("bayes_ssi.plots")
    api = import_module("bayes_ssi.api")
    if name != "__all__" and name not in api.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(api, name)


def __dir__() -> list[str]:
    """The public names alone, as editors and notebooks complete them."""
    return [*__getattr__("__all__"), "__version__", "plots"]
