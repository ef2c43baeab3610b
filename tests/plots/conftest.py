import matplotlib as mpl
import pytest


@pytest.fixture(autouse=True)
def _close_figures():
    mpl.use("agg")
    import matplotlib.pyplot as plt

    yield
    plt.close("all")
