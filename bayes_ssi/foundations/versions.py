"""Versions of the software that results depend on."""

from __future__ import annotations

import platform
import sys

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
