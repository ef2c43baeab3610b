"""The workers of a run for which none were chosen.

Whether an object can be used in any process: it holds data, and no code of a user's.
"""

import sys
from collections.abc import Sequence
from io import BytesIO
from types import FunctionType
from typing import Any

from bayes_ssi.inference.model_class.model_class import ModelClass
from bayes_ssi.inference.workers.local_workers import LocalWorkers, can_copy, usable_cores
from bayes_ssi.studies.ranking.class_sampling import is_cheap

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


# A new process takes about a second to import the package, the smallest classes half a second to
# be sampled: two processes save as much as they cost from here on.
CLASSES_FOR_NEW_PROCESSES = 4


def automatic_workers(candidates: Sequence[ModelClass], n_classes: int) -> LocalWorkers | None:
    """One process for each core that can be used, as far as they are busy; None if one is enough.

    None, too, where models hold a user's own code (see :func:`holds_user_code`), or classes are
    few and every process would have to import the package anew.
    """
    n = usable_cores()
    if all(map(is_cheap, candidates)):
        n = min(n, n_classes)
        if not can_copy() and n_classes < CLASSES_FOR_NEW_PROCESSES:
            return None
    if n == 1 or holds_user_code(list(candidates)):
        return None
    return _copies(n)


def chosen_workers(candidates: Sequence[ModelClass], n: int) -> LocalWorkers:
    """As many processes, but no more than cores that can be used."""
    n = min(n, usable_cores())
    if holds_user_code(list(candidates)):
        return LocalWorkers(n)
    return _copies(n)


def _copies(n: int) -> LocalWorkers:
    """Processes that are copies of this one, where that is possible, with all that they need."""
    if can_copy():
        import bayes_ssi.inference.sampling.moves  # noqa: F401 - once here, not in every copy
    return LocalWorkers(n, copies=True)
