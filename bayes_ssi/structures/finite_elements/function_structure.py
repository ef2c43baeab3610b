"""A structure computed by a function: any program, script or formula."""

import hashlib
import inspect
from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Mapping
from numbers import Integral
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bayes_ssi.foundations.argument_types import require
from bayes_ssi.foundations.arrays import FloatArray
from bayes_ssi.foundations.error_places import with_place
from bayes_ssi.parameters.parameters import (
    Parameter,
    Product,
    ProductTable,
    Value,
    as_product,
    parameters_of,
)
from bayes_ssi.structures.finite_elements import sparse_modes
from bayes_ssi.structures.finite_elements.elimination_order import fill_reducing_order
from bayes_ssi.structures.finite_elements.model_arguments import (
    Sensors,
    checked_matrix,
    sensor_rows,
)
from bayes_ssi.structures.modal import Modes, NoModesError, frequencies_hz
from bayes_ssi.structures.structure import Structure

# Memory for recent solutions: enough for hundreds of draws at 1000 sensors.
CACHE_BYTES = 64_000_000


class PointwiseStructure(Structure):
    """A structure that is solved at one row of values at a time.

    Recent solutions and errors are cached: a batch that failed in one row is evaluated again in
    parts, and the modes of stored draws are computed more than once.
    """

    is_solved_by_rows = True

    @abstractmethod
    def solved_at(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """Frequencies (n_modes,) and shapes (n_dof, n_modes) at ``values`` (n_parameters,).

        Further results of the same solution may follow. Where there are no modes, it raises, and
        :meth:`solution` adds the values to the message.
        """

    def modes(self, values: FloatArray) -> Modes:
        """See :meth:`Structure.modes`; what it raises names the values without modes, and why."""
        solutions = [self.solution(row) for row in values]
        n, n_dof, n_modes = len(values), len(self.degrees_of_freedom), self.n_modes
        return Modes(
            np.array([frequencies for frequencies, *_ in solutions]).reshape(n, n_modes),
            np.array([shapes for _, shapes, *_ in solutions]).reshape(n, n_dof, n_modes),
        )

    def solution(self, row: FloatArray) -> tuple[FloatArray, ...]:
        """:meth:`solved_at` for one row of values, cached; ValueError where that raises."""
        cache: OrderedDict[bytes, tuple[FloatArray, ...] | str]
        cache = self.__dict__.setdefault("_cache", OrderedDict())
        key = np.ascontiguousarray(row).tobytes()
        answer = cache.pop(key, None)
        if answer is None:
            try:
                answer = self.solved_at(row)
            except Exception as error:  # noqa: BLE001 - whatever a user's function may raise
                reason = with_place(error)
                if isinstance(error, ValueError):  # as the type of the answer says already
                    reason = reason.removeprefix(f"{type(error).__name__}: ")
                answer = f"at {self._named(row)}: {reason}"
        cache[key] = answer
        size = 8 * (len(self.degrees_of_freedom) + 1) * self.n_modes + 1000
        while len(cache) * size > CACHE_BYTES:
            cache.popitem(last=False)
        if isinstance(answer, str):
            raise ValueError(answer)
        return answer

    def _described_sensors(self) -> dict[str, str]:
        texts = [
            f"{sensor.label} = " + " + ".join(f"{share:g} {dof}" for dof, share in sensor.motion)
            for sensor in self.sensors
        ]
        return {"combined sensors": "; ".join(texts)} if texts else {}

    def _named(self, row: FloatArray) -> str:
        each = zip(self.parameters, row, strict=True)
        return ", ".join(f"{p.name} = {value:.6g}" for p, value in each) or "no parameters"

    def __getstate__(self) -> dict[str, Any]:
        """State without the cache, which need not be sent to workers."""
        state = super().__getstate__()
        assert isinstance(state, dict)
        return {name: value for name, value in state.items() if name != "_cache"}


class FunctionStructure(PointwiseStructure):
    """A structure whose modes or matrices are returned by a function of the parameters.

    The function is called once for each set of values, in whichever process evaluates them
    (``--workers N``). It returns either

    * ``K, M``: stiffness and mass, sparse or dense, (n, n); or
    * ``frequencies, shapes``: (m,) in Hz, ascending or not, and (n_sensors, m), m being
      ``n_modes`` or more; ``shapes`` may be None where no shape is measured. They are taken to be
      at unit modal mass; in another scale, close modes turn together as they are scaled, which is
      right where both have the same modal mass in it.

    Errors that it raises, and invalid answers, are reported with the arguments of the call; the
    likelihood of such values is zero.

    >>> k = bs.Parameter("k", bs.LogNormal(median=(2 * np.pi) ** 2, cov=0.3))
    >>> def mast(k):
    ...     return np.array([[k]]), np.array([[4.0]])  # stiffness and mass
    >>> mast = bs.FunctionStructure(mast, {"k": k}, n_modes=1, sensors={"top": 0})
    >>> mast.modes(mast.prior_medians()).frequencies_hz
    array([[0.5]])
    """

    parameters: tuple[Parameter, ...] = ()
    degrees_of_freedom: tuple[str, ...] = ()
    n_modes: int = 0

    def __init__(
        self,
        function: Callable[..., Any],
        arguments: Mapping[str, Value],
        *,
        n_modes: int,
        sensors: Sensors = (),
    ) -> None:
        """Check the arguments; nothing is called yet.

        Args:
            function: called with keyword arguments, all of them numbers.
            arguments: name of an argument → number, Parameter, or product such as
                ``30e9 * stiffness``.
            n_modes: number of lowest modes that are computed.
            sensors: for a function that returns modes, the names of the rows of the shapes; for
                one that returns matrices, name → number, from 0, of a degree of freedom.

        Raises:
            TypeError: the function is not callable, or an argument is not a number or Parameter.
            ValueError: the function has no such argument or lacks one, or ``n_modes`` or the
                sensors are not valid.
        """
        if not callable(function):
            raise TypeError(f"FunctionStructure: function must be callable, got {function!r}")
        require(arguments, Mapping[str, Any], "FunctionStructure: arguments")
        self.function = function
        where = f"FunctionStructure {_name(function)}"
        self._arguments: dict[str, Product] = {
            name: as_product(value, f"{where}: argument {name!r}")
            for name, value in arguments.items()
        }
        products = tuple(self._arguments.values())
        self.parameters = parameters_of(products)
        self._table = ProductTable(products, self.parameters)
        if not isinstance(n_modes, Integral) or isinstance(n_modes, bool) or n_modes < 1:
            raise ValueError(f"{where}: n_modes must be a positive whole number, got {n_modes!r}")
        self.n_modes = int(n_modes)
        try:
            inspect.signature(function).bind(**dict.fromkeys(arguments, 1.0))
        except TypeError as error:
            raise ValueError(f"{where}: {error}; arguments are {list(arguments)}") from None
        except ValueError:  # a function of C, perhaps, without a signature
            pass
        self._numbered: bool = isinstance(sensors, Mapping)
        self._rows: NDArray[np.intp]
        try:
            self.degrees_of_freedom, self._rows = _names_and_rows(sensors)
        except (TypeError, ValueError) as error:
            raise type(error)(f"{where}: {error}") from None

    def solved_at(self, values: FloatArray) -> tuple[FloatArray, ...]:
        first, second = self._called(values)
        if np.ndim(first) == 2 or sp.issparse(first):
            return self._of_matrices(first, second)
        return self._checked_modes(first, second)

    def description(self) -> Mapping[str, Any]:
        return {
            "function": _name(self.function),
            "arguments": self._arguments,
            "modes": f"the lowest {self.n_modes}",
            **self._described_sensors(),
        }

    def _called(self, values: FloatArray) -> tuple[Any, Any]:
        numbers = self._table.evaluate(values[None])[0].tolist()
        try:
            answer = self.function(**dict(zip(self._arguments, numbers, strict=True)))
        except SystemExit as exit_:  # scripts may end like this; this program goes on
            raise RuntimeError(f"{_name(self.function)} called exit({exit_.code!r})") from None
        if isinstance(answer, (tuple, list)) and len(answer) == 2:
            return answer[0], answer[1]
        raise ValueError(
            f"{_name(self.function)} must return two things, K and M or frequencies and shapes, "
            f"got {_kind(answer)}"
        )

    def _of_matrices(self, stiffness: Any, mass: Any) -> tuple[FloatArray, FloatArray]:
        name, n_modes = _name(self.function), self.n_modes
        n = np.shape(stiffness)[0]
        k, m = checked_matrix(stiffness, f"{name}: K"), checked_matrix(mass, f"{name}: M", n)
        if n < n_modes:
            raise ValueError(f"{name}: K has {n} rows, fewer than {n_modes} modes")
        rows = self._rows
        if (rows >= n).any() or not (self._numbered or len(rows) in (0, n)):
            raise ValueError(
                f"{name}: K has {n} rows; sensors must be a mapping of names to numbers of degrees "
                f"of freedom, from 0 to {n - 1}"
            )
        k, m = sp.csc_array(k), sp.csc_array(m)
        if n > sparse_modes.DENSE_UP_TO:
            if not sparse_modes.is_semidefinite(m):
                raise NoModesError(f"{name}: M is not positive semi-definite")
            # The pattern, and so the order, may change from call to call.
            order = fill_reducing_order(k)
            k, m = (sp.csc_array(matrix[order][:, order]) for matrix in (k, m))
            rows = np.argsort(order)[rows]
        modes = sparse_modes.lowest_modes(k, m, n_modes)
        return frequencies_hz(modes.eigenvalues[:n_modes]), modes.vectors[rows, :n_modes]

    def _checked_modes(self, frequencies: Any, shapes: Any) -> tuple[FloatArray, FloatArray]:
        name = _name(self.function)
        f = np.asarray(frequencies, dtype=float)
        if f.ndim != 1 or len(f) < self.n_modes:
            raise ValueError(
                f"{name} must return at least {self.n_modes} frequencies, got shape {f.shape}"
            )
        n_sensors = len(self.degrees_of_freedom)
        if shapes is None and not n_sensors:
            shapes = np.empty((0, len(f)))
        phi = np.asarray(shapes)
        if phi.dtype.kind not in "iuf" or phi.shape != (n_sensors, len(f)):
            raise ValueError(
                f"{name} must return real shapes with one row per sensor and one column per mode, "
                f"{(n_sensors, len(f))}, got {_kind(shapes)}"
                + (", its transpose" if phi.shape == (len(f), n_sensors) else "")
            )
        order = np.argsort(f, kind="stable")[: self.n_modes]  # NaN comes last
        f, phi = f[order], phi[:, order].astype(float)
        if not (np.isfinite(f).all() and np.isfinite(phi).all()):
            raise ValueError(f"{name} returned numbers that are not finite")
        if not f[0] > 0.0:
            raise ValueError(f"{name} returned a frequency of {f[0]:.6g} Hz, which is not positive")
        return f, phi

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={each!r}" for name, each in self._arguments.items())
        return (
            f"FunctionStructure({_name(self.function)} <{_digest(self.function)}>, {arguments}, "
            f"sensors={dict(zip(self.degrees_of_freedom, self._rows.tolist(), strict=True))}, "
            f"n_modes={self.n_modes})"
        )


def _names_and_rows(sensors: Sensors) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Sensors of a model whose number of degrees of freedom is not known yet."""
    if isinstance(sensors, Mapping):
        numbers = [int(number) for number in sensors.values() if isinstance(number, Integral)]
        return sensor_rows(max(numbers, default=0) + 1, None, sensors)
    return sensor_rows(len(sensors), tuple(map(str, sensors)), None)


def _name(function: Callable[..., Any]) -> str:
    return str(getattr(function, "__qualname__", type(function).__qualname__))


def _kind(answer: Any) -> str:
    shape = getattr(answer, "shape", None)
    return f"{type(answer).__name__} of shape {shape}" if shape is not None else repr(answer)[:80]


def _digest(function: Callable[..., Any]) -> str:
    """Digest of the function's source, to distinguish functions of the same name."""
    try:
        text = inspect.getsource(function)
    except (OSError, TypeError):
        text = _name(function)
    return hashlib.sha256(text.encode()).hexdigest()[:12]
