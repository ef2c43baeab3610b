"""Installed packages: their versions, and those that are optional."""

import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PACKAGES = ("bayes_ssi", "numpy", "scipy", "emcee", "arviz")


def versions() -> dict[str, str]:
    """Name → version of Python, the platform and the packages that results depend on."""
    from importlib.metadata import PackageNotFoundError, version

    installed = {"python": platform.python_version(), "platform": sys.platform}
    for package in PACKAGES:
        try:
            installed[package] = version(package)
        except PackageNotFoundError:  # run from a source tree that is not installed
            installed[package] = "not installed"
    return installed


@contextmanager
def optional_package(name: str, extra: str) -> Iterator[None]:
    """Within it, an optional package is imported; one line says how to install it."""
    try:
        yield
    except ImportError:
        raise ValueError(
            f'{name} is not installed; install it with pip install "bayes_ssi[{extra}]"'
        ) from None
