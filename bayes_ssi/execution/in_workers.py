"""Inside a worker: how a function comes there, is kept, and is called.

A function is sent once to each worker that asks for it, and known by its digest from then on.
"""

from __future__ import annotations

import os
import sys
from collections import OrderedDict
from collections.abc import Callable
from threading import Thread
from time import sleep
from typing import Any

from threadpoolctl import threadpool_limits

__all__ = ["STUDY_MODULE", "call_there", "call_with_pickled", "end_with_parent", "pickled"]

# Modules of study files carry this prefix; their content is sent along, since no worker could
# import them.
STUDY_MODULE = "bayes_ssi_study_"
MODELS_KEPT = 8
# How often a worker looks whether the process that made it is still there.
PARENT_SECONDS = 0.5

_models: OrderedDict[str, Callable[[Any], Any]] = OrderedDict()


def pickled(what: object) -> bytes:
    """Anything as bytes, with what it needs of a study file.

    Raises:
        ValueError: it cannot be sent.
    """
    import cloudpickle

    studies = [m for name, m in sys.modules.items() if name.startswith(STUDY_MODULE)]
    for module in studies:
        cloudpickle.register_pickle_by_value(module)
    try:
        data: bytes = cloudpickle.dumps(what)
    except Exception as error:
        raise ValueError(
            f"the model cannot be sent to a worker: {type(error).__name__}: {error}"
        ) from error
    finally:
        for module in studies:
            cloudpickle.unregister_pickle_by_value(module)
    return data


def call_there(key: str, payload: bytes | None, argument: Any, owner: int) -> tuple[Any, ...]:
    """The answer of a function to an argument, alone in a tuple; empty if it is not here yet.

    Args:
        key: the function's digest.
        payload: the function, pickled; None for one that should be here.
        argument: of the function.
        owner: the process that sent it; a worker may be a thread of the same.
    """
    if key not in _models:
        if payload is None:
            return ()
        _models[key] = _rebuilt(payload)
        if os.getpid() != owner:
            # Threads of BLAS in several processes would only wait for one another.
            threadpool_limits(limits=1, user_api="blas")
        while len(_models) > MODELS_KEPT:
            _models.popitem(last=False)
    return (_models[key](argument),)


def call_with_pickled(function: Callable[[Any], Any], item: bytes) -> Any:
    """``function`` of an item that was pickled here, and not by the executor."""
    return function(_rebuilt(item))


def end_with_parent() -> None:
    """End when the process that made this one is gone, however it went."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            sleep(PARENT_SECONDS)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def _rebuilt(payload: bytes) -> Any:
    import cloudpickle

    try:
        return cloudpickle.loads(payload)
    except Exception as error:
        raise ValueError(
            f"the model cannot be rebuilt in a worker: {type(error).__name__}: {error}"
        ) from error
