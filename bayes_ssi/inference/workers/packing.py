"""What is sent to workers: pickled functions, which a worker unpickles only once."""

import hashlib
import multiprocessing.connection
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from threading import Lock, Thread
from time import sleep
from typing import Any

from threadpoolctl import threadpool_limits

# Modules of study files carry this prefix. No worker could import them, so they are pickled too.
STUDY_MODULE = "bayes_ssi_study_"
_UNPACKING = Lock()


@dataclass(frozen=True)
class PackedFunction:
    """A pickled function to be sent to workers."""

    digest: str
    sender: int = field(compare=False)
    # Or a file that holds it: models may hold large matrices.
    content: bytes | Path = field(compare=False, repr=False)

    @classmethod
    def of(cls, data: bytes, content: bytes | Path) -> "PackedFunction":
        return cls(hashlib.blake2b(data, digest_size=16).hexdigest(), os.getpid(), content)


def pickled(what: object) -> bytes:
    """Any object as bytes, including the code from a study file that it needs."""
    import cloudpickle

    studies = [m for name, m in sys.modules.items() if name.startswith(STUDY_MODULE)]
    for module in studies:
        cloudpickle.register_pickle_by_value(module)
    try:
        data: bytes = cloudpickle.dumps(what)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"the model cannot be sent to a worker: {reason}") from error
    finally:
        for module in studies:
            cloudpickle.unregister_pickle_by_value(module)
    return data


def call_packed(function: PackedFunction, item: bytes) -> Any:
    """The function's value at a pickled item."""
    with _UNPACKING:  # of two threads that come first, both would unpickle it
        unpacked = _unpacked(function)
    return unpacked(_unpickled(item))


# Batch after batch is evaluated by the same function until a class is done.
@lru_cache(maxsize=1)
def _unpacked(function: PackedFunction) -> Callable[[Any], Any]:
    content = function.content
    data = content if isinstance(content, bytes) else content.read_bytes()
    unpacked: Callable[[Any], Any] = _unpickled(data)
    if os.getpid() != function.sender:  # a worker may be a thread of the same process
        # BLAS threads of several processes would compete for the same cores.
        threadpool_limits(limits=1, user_api="blas")
    return unpacked


def _unpickled(data: bytes) -> Any:
    import cloudpickle

    try:
        return cloudpickle.loads(data)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"the model cannot be rebuilt in a worker: {reason}") from error


def end_with_parent() -> None:
    """End this process when its parent process is gone for any reason."""
    parent = os.getppid()
    process = multiprocessing.parent_process()
    # A copy of its parent has a pipe that breaks with it; other processes have to look.
    pipe: int | None = process.sentinel if process is not None else None

    def watch() -> None:
        while os.getppid() == parent:
            if pipe is None:
                sleep(0.5)
            else:
                multiprocessing.connection.wait([pipe], timeout=0.5)
        os._exit(1)

    Thread(target=watch, daemon=True).start()
