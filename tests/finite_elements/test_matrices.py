"""A structure by its matrices, against closed forms and dense solutions."""

import math

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse as sp
from chains import membrane
from conftest import assert_refused, multiplier
from scipy.sparse.linalg import splu

import bayes_ssi as bs
from bayes_ssi.structures.finite_elements import sparse_modes
from bayes_ssi.structures.finite_elements.elimination_order import fill_reducing_order
from bayes_ssi.structures.modal import Eigenpairs, NoModesError, mac

K3 = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])


def chain(n):
    """Stiffness of n unit masses between unit springs, the first of which is held."""
    diagonals = [np.r_[np.full(n - 1, 2.0), 1.0], np.full(n - 1, -1.0)]
    return sp.diags_array([diagonals[0], diagonals[1], diagonals[1]], offsets=[0, 1, -1]).tocsc()


def chain_hz(n, modes):
    """f_j = (1/π) sin((2j - 1)π/(2(2n + 1)))."""
    return np.sin((2 * np.arange(1, modes + 1) - 1) * math.pi / (2 * (2 * n + 1))) / math.pi


class TestModes:
    def test_small_and_dense(self):
        k1, k2 = multiplier("k1"), multiplier("k2")
        parts = np.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0]])
        structure = bs.MatrixStructure([(2.0 * k1, parts), (k2**2, K3 - parts)], np.eye(3),
                                       n_modes=3)  # fmt: skip
        assert [p.name for p in structure.parameters] == ["k1", "k2"]
        assert structure.description()["stiffness"] == "k1 · K1 + k2**2 · K2"
        values = np.array([[1.3, 0.7]])
        expected, vectors = np.linalg.eigh(2.6 * parts + 0.49 * (K3 - parts))
        frequencies, shapes = structure.modes(values)
        np.testing.assert_allclose(frequencies[0], np.sqrt(expected) / (2 * math.pi), rtol=1e-12)
        np.testing.assert_allclose(np.diag(mac(shapes[0], vectors)), 1.0, atol=1e-12)
        np.testing.assert_allclose(shapes[0].T @ shapes[0], np.eye(3), atol=1e-12)

    def test_long_chain(self):
        structure = bs.MatrixStructure((multiplier("k"), chain(400)), sp.eye_array(400), n_modes=6,
                                       sensors={"top": 399, "middle": 200})  # fmt: skip
        frequencies, shapes = structure.modes(np.array([[1.0], [4.0]]))
        expected = chain_hz(400, 6)
        np.testing.assert_allclose(frequencies, [expected, 2.0 * expected], rtol=1e-9)
        assert shapes.shape == (2, 2, 6)
        # φ_i ∝ sin(i (2j - 1)π/(2n + 1)), i counted from 1.
        angle = (2 * np.arange(1, 7) - 1) * math.pi / 801
        ratio = np.sin(201 * angle) / np.sin(400 * angle)
        np.testing.assert_allclose(shapes[0, 1] / shapes[0, 0], ratio, rtol=1e-6)

    def test_degrees_of_freedom_without_mass(self):
        # Every second mass of the chain is taken away: two springs in series are half as stiff.
        n = 300
        structure = bs.MatrixStructure(chain(n), sp.diags_array(np.arange(n) % 2 * 1.0), n_modes=5)
        expected = chain_hz(n // 2, 5) * math.sqrt(0.5)
        np.testing.assert_allclose(structure.modes(np.zeros((1, 0)))[0][0], expected, rtol=1e-9)

    @pytest.mark.parametrize("rank", [4, 6, 20])
    @pytest.mark.parametrize("spread", [3, 60])
    def test_masses_of_low_rank(self, rank, spread):
        """Rigid bodies, each carried by ``spread`` degrees of freedom; 4 modes are wanted."""
        n = 500
        carried = np.zeros((n, rank))
        for i in range(rank):
            places = (np.arange(spread) + spread * i) % n
            carried[places, i] += 1.0 + i + np.linspace(0.0, 1.0, spread)
        stiffness = sp.csc_array(1e4 * chain(n))
        structure = bs.MatrixStructure(stiffness, carried @ carried.T, n_modes=4)
        # The nonzero μ of B Bᵀ φ = μ K φ are those of Bᵀ K⁻¹ B, (rank, rank).
        flexibility = carried.T @ np.linalg.solve(stiffness.toarray(), carried)
        expected = np.sqrt(1.0 / np.linalg.eigvalsh(flexibility)[::-1][:4]) / (2.0 * math.pi)
        frequencies, shapes = structure.modes(np.zeros((1, 0)))
        np.testing.assert_allclose(frequencies[0], expected, rtol=1e-7)
        moved = carried.T @ shapes[0]
        np.testing.assert_allclose(moved.T @ moved, np.eye(4), atol=1e-7)
        reduced = structure.reduced().modes(np.zeros((1, 0))).frequencies_hz[0]
        np.testing.assert_allclose(reduced, expected, rtol=1e-6)

    def test_as_many_modes_as_lie_in_the_band(self):
        top = float(chain_hz(400, 7)[6]) / 1.2 * 1.001  # a fifth above it lies the seventh
        assert bs.MatrixStructure(chain(400), sp.eye_array(400), up_to_hz=top).n_modes == 7

    def test_rows_do_not_depend_on_their_batch(self):
        k = multiplier("k")
        for n in (3, 60, 200):
            structure = bs.MatrixStructure([(k, chain(n)), 0.1 * sp.eye_array(n)],
                                           sp.eye_array(n), n_modes=3)  # fmt: skip
            values = np.random.default_rng(0).lognormal(0.0, 0.3, (7, 1))
            together = structure.modes(values)
            alone = [bs.MatrixStructure([(k, chain(n)), 0.1 * sp.eye_array(n)], sp.eye_array(n),
                                        n_modes=3).modes(row[None]) for row in values]  # fmt: skip
            np.testing.assert_array_equal(together[0], [one[0][0] for one in alone])
            np.testing.assert_array_equal(together[1], [one[1][0] for one in alone])

    def test_response_needs_how_the_ground_moves_it(self):
        structure = bs.MatrixStructure(K3, np.diag([1.0, 2.0, 3.0]), n_modes=3, influence=[1, 1, 1])
        model = structure.modal_model(np.zeros((1, 0)))
        # With all modes the effective masses add up to all of the mass.
        assert (model.participation**2).sum() == pytest.approx(6.0)
        with pytest.raises(TypeError, match="give influence="):
            bs.MatrixStructure(K3, np.eye(3), n_modes=3).modal_model(np.zeros((1, 0)))


def entries(matrix, order, permc_spec="NATURAL"):
    """Of the factors, in an order that is kept or improved."""
    ordered = sp.csc_matrix(matrix[order][:, order])
    return splu(ordered, permc_spec, 0.0, options={"SymmetricMode": True}).nnz


def test_rows_are_ordered_for_sparse_factors():
    # Numbered without an order, as in a mesh that was refined by hand.
    matrix, mixed = membrane(40), np.random.default_rng(1).permutation(1600)
    matrix = sp.csc_array(matrix[mixed][:, mixed])
    same = np.arange(matrix.shape[0])
    by_degree = entries(matrix, same, "MMD_AT_PLUS_A")
    assert by_degree < 0.5 * entries(matrix, same)
    assert entries(matrix, fill_reducing_order(matrix)) == by_degree


def test_a_frame_of_many_bays_is_divided():
    # Nodes n each way; of beams along each axis, what couples besides like motions.
    n, one = 10, sp.eye_array(10)
    line = sp.diags_array([np.ones(n - 1), np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1])
    frame = sp.csc_array((6 * n**3, 6 * n**3))
    for axis, bent in enumerate([((1, 5), (2, 4)), ((0, 5), (2, 3)), ((0, 4), (1, 3))]):
        x, y, z = (line if axis == i else one for i in range(3))
        coupled = np.eye(6)
        for pair in bent:
            coupled[pair, pair[::-1]] = 1.0
        frame = frame + sp.kron(sp.kron(sp.kron(x, y), z), coupled)
    mixed = np.random.default_rng(3).permutation(6 * n**3)
    frame = sp.csc_array(100.0 * sp.eye_array(6 * n**3) - frame[mixed][:, mixed])
    by_degree = entries(frame, np.arange(6 * n**3), "MMD_AT_PLUS_A")
    order = fill_reducing_order(frame)
    np.testing.assert_array_equal(np.sort(order), np.arange(6 * n**3))
    assert entries(frame, order) < 0.75 * by_degree


class TestCounting:
    def test_counts_by_inertia(self):
        stiffness, mass = membrane(12), sp.csc_array(sp.eye_array(144))
        order = fill_reducing_order(stiffness)
        ordered = sp.csc_array(stiffness[order][:, order])
        line = 4.0 * np.sin(np.arange(1, 13) * math.pi / 26) ** 2
        eigenvalues = np.add.outer(line, line)
        for shift in (0.01, 0.503, 2.03, 5.07):
            assert sparse_modes.count_below(ordered, mass, shift) == (eigenvalues < shift).sum()

    @pytest.mark.parametrize(("gap", "last"), [(1.5e-6, 1), (0.7e-6, None)])
    def test_a_millionth_is_a_gap(self, gap, last):
        assert sparse_modes._last_before_a_gap(np.array([1.0, 1.0 + gap]), 1) == last

    def test_a_mode_that_lanczos_overlooks_is_noticed(self, monkeypatch):
        stiffness, mass = membrane(20), sp.csc_array(sp.eye_array(400))
        order = fill_reducing_order(stiffness)
        ordered = sp.csc_array(stiffness[order][:, order])
        honest = sparse_modes._lanczos

        def forgetful(k, m, factor, n_modes, attempt):
            result = honest(k, m, factor, n_modes + 1, attempt)
            keep = np.delete(np.arange(n_modes + 1), 1)
            return Eigenpairs(result.eigenvalues[keep], result.vectors[:, keep])

        monkeypatch.setattr(sparse_modes, "_lanczos", forgetful)
        with pytest.raises(NoModesError, match="Sylvester"):
            sparse_modes.lowest_modes(ordered, mass, 4)

    def test_semidefinite(self):
        assert sparse_modes.is_semidefinite(sp.csc_array(np.array([[1.0, -1.0], [-1.0, 1.0]])))
        assert not sparse_modes.is_semidefinite(sp.csc_array(np.array([[1.0, -2.0], [-2.0, 1.0]])))
        assert not sparse_modes.is_semidefinite(sp.csc_array(-np.eye(2)))


def test_a_large_consistent_mass_is_definite_and_with_one_negative_eigenvalue_it_is_not():
    mass = sp.diags_array([1 / 6, 2 / 3, 1 / 6], offsets=[-1, 0, 1], shape=(400, 400))
    assert sparse_modes.is_semidefinite(sp.csc_array(mass))
    for seed in range(5):
        # Of the two ends of a link far apart, as an element with a wrong sign gives.
        i, k = np.random.default_rng(seed).choice(400, 2, replace=False)
        wrong = sp.csc_array(([0.4, 0.4, 0.4, 0.4], ([i, i, k, k], [i, k, i, k])), shape=(400, 400))
        assert np.linalg.eigvalsh((mass - wrong).toarray())[0] < 0.0
        assert not sparse_modes.is_semidefinite(sp.csc_array(mass - wrong))


BAD = [
    ({"stiffness": K3[:2]}, r"stiffness: the matrix must be square, got shape \(2, 3\)"),
    ({"stiffness": np.triu(K3)}, "must be symmetric.*was only one triangle stored"),
    ({"stiffness": [K3, np.eye(2)]}, "stiffness, term 2: the matrix has 2 rows"),
    ({"mass": np.eye(2)}, "mass: the matrix has 2 rows, the matrices before it 3"),
    ({"mass": np.full((3, 3), np.nan)}, "numbers that are not finite"),
    ({"mass": 1j * np.eye(3)}, "must be real"),
    ({"stiffness": []}, "stiffness: no term"),
    ({"stiffness": [(math.inf, K3)]}, "coefficient must be finite"),
    ({"labels": ("a", "b", "a")}, "labels: 'a' names two degrees of freedom"),
    ({"labels": ("a", "b")}, "labels: 2 for 3 degrees of freedom"),
    ({"sensors": {"roof": 3}}, "sensor 'roof': must be the number .*, from 0 to 2, or .*, got 3"),
    ({"sensors": {"roof": "x"}}, "sensor 'roof': .* its label .none was given., got 'x'"),
    ({"labels": ("a", "b", "c"), "sensors": ["a", 2]}, "sensors: a list holds labels; .*'a', 2"),
    ({"n_modes": 4}, "n_modes must be a whole number from 1 to 3"),
    ({"n_modes": None}, "give either n_modes or up_to_hz"),
    ({"n_modes": None, "up_to_hz": -1.0}, "up_to_hz must be a positive frequency"),
    ({"influence": [1.0, 1.0]}, "influence must be 3 finite numbers"),
    ({"mass": "m.npz"}, "mass: the matrix must be an array, got 'm.npz'; read a file with read_m"),
]


@pytest.mark.parametrize(("wrong", "message"), BAD)
def test_bad_input_is_refused_in_one_line(wrong, message):
    with pytest.raises((ValueError, TypeError), match=message) as caught:
        bs.MatrixStructure(**{"stiffness": K3, "mass": np.eye(3), "n_modes": 2, **wrong})
    assert "\n" not in str(caught.value)


def test_a_large_model_must_name_its_sensors():
    with pytest.raises(ValueError, match="here 1200, must name the measured ones"):
        bs.MatrixStructure(chain(1200), sp.eye_array(1200), n_modes=3)


@pytest.mark.parametrize(
    ("stiffness", "mass", "message"),
    [
        (-K3, np.eye(3), "the stiffness matrix is not positive definite"),
        (K3 - K3[0, 0] * np.eye(3), np.eye(3), "the stiffness matrix is not positive definite"),
        (K3, -np.eye(3), "the mass matrix is not positive semi-definite"),
        (K3, np.diag([1.0, 0.0, 0.0]), "mass at 1 degrees of freedom, which gives fewer modes"),
        (K3, np.ones((3, 3)), "gives 1 modes, fewer than the 2 asked for"),
    ],
)
def test_matrices_without_modes(stiffness, mass, message):
    structure = bs.MatrixStructure((multiplier("k"), stiffness), mass, n_modes=2)
    assert_refused(message, structure.modes, np.ones((1, 1)))


@pytest.mark.parametrize("rank", [0, 2])
@pytest.mark.parametrize("reduced", [False, True])
def test_masses_of_too_low_rank(rank, reduced):
    carried = np.zeros((400, 2))
    carried[5:10, 0] = carried[12:17, 1] = 1.0
    mass = sp.csc_array(carried[:, :rank] @ carried[:, :rank].T)
    structure = bs.MatrixStructure((multiplier("k"), chain(400)), mass, n_modes=3)
    structure = structure.reduced() if reduced else structure
    with pytest.raises(ValueError, match=f"{rank} (modes|degrees of freedom).* fewer.* than the 3"):
        structure.modes(np.ones((1, 1)))


@pytest.mark.parametrize("n", [3, 30, 100, 300])
def test_a_structure_that_is_not_supported_has_a_rigid_body_mode(n):
    """The sums of a row's springs are zero but for rounding; the softest support is one."""
    springs = np.random.default_rng(n).uniform(0.1, 10.0, n - 1)
    diagonals = [np.r_[springs, 0.0] + np.r_[0.0, springs], -springs]
    loose = sp.diags_array([*diagonals, diagonals[1]], offsets=[0, 1, -1])
    structure = bs.MatrixStructure((multiplier("k"), loose), sp.eye_array(n), n_modes=2)
    assert structure.n_rigid_modes == 1
    elastic = np.sqrt(np.linalg.eigvalsh(loose.toarray())[1:3]) / (2.0 * math.pi)
    for values in np.random.default_rng(n).uniform(0.5, 2.0, (5, 1, 1)):
        found = structure.modes(values).frequencies_hz[0]
        np.testing.assert_allclose(found, math.sqrt(values[0, 0]) * elastic, rtol=1e-8)
    held = sp.csc_array(loose + sp.diags_array(np.r_[1e-6, np.zeros(n - 1)]))
    structure = bs.MatrixStructure((multiplier("k"), held), sp.eye_array(n), n_modes=2)
    assert structure.n_rigid_modes == 0
    first = structure.modes(np.ones((1, 1))).frequencies_hz[0, 0]
    assert first == pytest.approx(math.sqrt(1e-6 / n) / (2.0 * math.pi), rel=1e-3)


@pytest.mark.parametrize("n", [3, 60, 200])
def test_negative_parameters_are_named(n):
    k = bs.Parameter("k", bs.Normal(1.0, 1.0))
    structure = bs.MatrixStructure((k, chain(n)), sp.eye_array(n), n_modes=2)
    with pytest.raises(ValueError, match="at k = -2: the stiffness matrix is not positive def"):
        structure.modes(np.array([[1.0], [-2.0]]))


class TestFiles:
    def test_forms(self, tmp_path):
        sparse = chain(5)
        sp.save_npz(tmp_path / "k.npz", sparse)
        np.savez(tmp_path / "both.npz", K=sparse.toarray(), M=np.eye(5))
        scipy.io.mmwrite(tmp_path / "k.mtx", sparse)
        scipy.io.savemat(tmp_path / "k.mat", {"K": sparse, "M": np.eye(5)})
        for name, key in (("k.npz", None), ("both.npz", "K"), ("k.mtx", None), ("k.mat", "K")):
            read = bs.read_matrix(tmp_path / name, key)
            assert not sp.isspmatrix(read)  # of which * is the product of matrices
            dense = read.toarray() if sp.issparse(read) else read
            np.testing.assert_array_equal(dense, sparse.toarray())

    def test_matlab_7_3(self, tmp_path):
        with h5py.File(tmp_path / "k.mat", "w", userblock_size=512) as file:
            file.create_dataset("M", data=np.eye(5))
            file.create_dataset("model/C", data=np.arange(6.0).reshape(2, 3))
            text = file.create_dataset("#refs#/a", data=np.ones(3))
            file.create_dataset("cell", data=np.array([text.ref], dtype=h5py.ref_dtype))
        with (tmp_path / "k.mat").open("r+b") as file:
            text = b"MATLAB 7.3 MAT-file".ljust(124)
            file.write(text + b"\x00\x02IM")
        np.testing.assert_array_equal(bs.read_matrix(tmp_path / "k.mat", "M"), np.eye(5))
        of_struct = bs.read_matrix(tmp_path / "k.mat", "model/C")
        np.testing.assert_array_equal(of_struct, [[0.0, 3.0], [1.0, 4.0], [2.0, 5.0]])
        with pytest.raises(ValueError, match="no array 'cell'; choose from 'M', 'model/C'"):
            bs.read_matrix(tmp_path / "k.mat", "cell")

    @pytest.mark.parametrize(
        ("name", "write"),
        [
            ("k.npz", sp.save_npz),
            ("k.mtx", scipy.io.mmwrite),
            ("k.mat", lambda path, sparse: scipy.io.savemat(path, {"K": sparse})),
            ("k.npy", lambda path, sparse: np.save(path, sparse.toarray())),
        ],
    )
    def test_truncated(self, tmp_path, name, write):
        path = tmp_path / name
        write(path, chain(60))
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2])
        assert_refused(rf"{name}: cannot be read; damaged or truncated", bs.read_matrix, path)

    def test_keys(self, tmp_path):
        path = tmp_path / "both.npz"
        np.savez(path, K=np.eye(2), M=np.eye(2))
        assert_refused("no array 'C'; choose from 'K', 'M'", bs.read_matrix, path, "C")
        assert_refused("no key says which; choose from 'K', 'M'", bs.read_matrix, path)
        with pytest.raises(FileNotFoundError):
            bs.read_matrix(tmp_path / "none.mat", "K")
        (tmp_path / "k.txt").touch()
        assert_refused(r"k\.txt: unknown format", bs.read_matrix, tmp_path / "k.txt")


def test_large_structures_are_better_reduced():
    small, *reduced, large = (
        bs.MatrixStructure((multiplier("k"), chain(n)), sp.eye_array(n), n_modes=2)
        for n in (36, 37, 40, 41)
    )
    assert [model.performance_hint for model in (small, *reduced)] == [""] * 3
    assert large.performance_hint.startswith("41 degrees of freedom, solved in full")
    assert small.for_many_hypotheses is small
    for model in (*reduced, large):
        assert model.for_many_hypotheses.exact is model is not model.for_many_hypotheses
    assert large.for_many_hypotheses is large.for_many_hypotheses  # of all tests of one structure
