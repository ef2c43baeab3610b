"""Identified modes from the files and results of other tools, with the real packages."""

import numpy as np
import pytest

import bayes_ssi as bs

NODES = [11, 12, 13]
SHAPES = np.array([[0.3, 0.6, 0.74], [-0.78, -0.29, 0.55]])


def normal_mode(number, frequency_hz, shape):
    return {
        "type": 55, "id1": "NONE", "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE",
        "model_type": 1, "analysis_type": 2, "data_ch": 2, "spec_data_type": 8, "data_type": 2,
        "n_data_per_node": 3, "load_case": 1, "mode_n": number, "freq": frequency_hz,
        "modal_m": 1.0, "modal_damp_vis": 0.01, "modal_damp_his": 0.0, "node_nums": NODES,
        "r1": np.array(shape), "r2": np.zeros(3), "r3": np.zeros(3),
    }  # fmt: skip


def complex_mode(number, eigenvalue, shape):
    return {
        **normal_mode(number, 0.0, np.real(shape)), "analysis_type": 3, "data_type": 5,
        "eig": eigenvalue, "modal_a": 1.0 + 0j, "modal_b": 1.0 + 0j,
        "r1": np.array(shape, dtype=complex), "r2": np.zeros(3, complex),
        "r3": np.zeros(3, complex),
    }  # fmt: skip


def write(path, sets):
    pyuff = pytest.importorskip("pyuff", reason="pip install bayes_ssi[uff]")
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


def test_normal_modes_of_a_universal_file(tmp_path):
    sets = [normal_mode(2, 2.76, SHAPES[1]), normal_mode(1, 0.96, SHAPES[0])]
    data = bs.read_modal_data(write(tmp_path / "modes.uff", sets), band_hz=(0, 6))
    assert data.sensors == ("11 x", "12 x", "13 x")
    np.testing.assert_allclose(data.frequencies_hz, [0.96, 2.76], rtol=1e-5)
    expected = SHAPES / np.linalg.norm(SHAPES, axis=1, keepdims=True)
    np.testing.assert_allclose(data.unit_shapes, expected.T, atol=1e-5)
    assert data.modes[0].damping == pytest.approx(0.01, rel=1e-4)
    assert not np.iscomplexobj(data.modes[0].shape)


def test_complex_modes(tmp_path):
    # ω = 6 rad/s, damping 2 %: λ = -0.12 ± 5.9988 i; a shape turned by 30 degrees.
    eigenvalue = 6.0 * (-0.02 + 1j * np.sqrt(1 - 0.02**2))
    turned = SHAPES[0] * np.exp(1j * np.pi / 6)
    path = write(tmp_path / "modes.uff", [complex_mode(1, eigenvalue, turned)])
    (mode,) = bs.read_modal_data(path, band_hz=(0, 6)).modes
    assert mode.frequency_hz == pytest.approx(6.0 / (2 * np.pi), rel=1e-5)
    assert mode.damping == pytest.approx(0.02, rel=1e-4)
    expected = SHAPES[0] / np.linalg.norm(SHAPES[0])
    np.testing.assert_allclose(mode.unit_shape * np.sign(mode.unit_shape[0]), expected, atol=1e-5)


def test_a_node_that_a_mode_lacks_was_not_measured(tmp_path):
    short = normal_mode(2, 2.76, SHAPES[1][:2]) | {"node_nums": NODES[:2]}
    short |= {"r2": np.zeros(2), "r3": np.zeros(2)}
    path = write(tmp_path / "modes.uff", [normal_mode(1, 0.96, SHAPES[0]), short])
    data = bs.read_modal_data(path, band_hz=(0, 6))
    assert np.isnan(data.unit_shapes).tolist() == [[False, False], [False, False], [False, True]]


def test_errors_of_a_universal_file_are_explained(tmp_path):
    path = write(tmp_path / "modes.uff", [normal_mode(1, 0.96, SHAPES[0])])
    with pytest.raises(FileNotFoundError):
        bs.read_modal_data(tmp_path / "none.uff", band_hz=(0, 6))
    damaged = tmp_path / "damaged.uff"
    damaged.write_text(path.read_text()[:700])
    with pytest.raises(ValueError, match=r"damaged\.uff"):
        bs.read_modal_data(damaged, band_hz=(0, 6))
