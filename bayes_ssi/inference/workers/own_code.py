"""Whether an object can be used in any process: it holds data, and no code of a user's."""

from __future__ import annotations

import sys
from io import BytesIO
from types import FunctionType
from typing import Any

# Their objects have no state beyond themselves.
KNOWN_PACKAGES = {"bayes_ssi", "numpy", "scipy", *sys.stdlib_module_names}


class _UserCodeError(Exception):
    """A function or a class is of another package, a study file, or a notebook."""


def holds_user_code(what: object) -> bool:
    """Whether ``what`` holds functions, or objects of classes, that a user wrote or imported.

    These may have a state, such as open files, a licence, or a counter, that processes do not
    share. So may objects that cannot be pickled.
    """
    import cloudpickle

    class Inspector(cloudpickle.Pickler):
        def reducer_override(self, item: Any) -> Any:
            kind = item if isinstance(item, type | FunctionType) else type(item)
            if kind.__module__.partition(".")[0] not in KNOWN_PACKAGES:
                raise _UserCodeError
            return super().reducer_override(item)

    try:
        # Arrays are handed to the callback, which drops them, instead of being copied.
        Inspector(BytesIO(), protocol=5, buffer_callback=lambda _: None).dump(what)
    except Exception:  # noqa: BLE001 - whatever an object's own pickling may raise
        return True
    return False
