"""Joint and correlated errors by their definition, entry by entry."""

import math

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal, norm

from bayes_ssi.parameters.parameters import as_product


def column(candidate, values, value):
    """Values of a field of the error model at every row."""
    product = as_product(value)
    names = [parameter.name for parameter in product.parameters]
    at = [candidate.parameter_names.index(name) for name in names]
    return product.scale * values[:, at].prod(axis=1)


def rotation(start, end):
    """The matrix of the rotation in the plane of two unit vectors that turns one into the other."""
    generator = np.outer(end, start) - np.outer(start, end)
    return np.eye(len(start)) + generator + generator @ generator / (1.0 + start @ end)


class Dense:
    """Residuals at one set of values and their covariance, entry by entry from the definition."""

    def __init__(self, candidate, row):
        error = candidate.error
        self.sf, self.ss, self.tests, self.between = (
            column(candidate, row, value)[0]
            for value in (
                error.frequency_cov,
                error.shape_sd,
                error.between_tests,
                error.between_modes,
            )
        )
        self.by_label = error.between_modes == 0.0
        self.kinds, self.residuals, own = [], [], []
        self.means = self.mean_shapes(candidate, row)
        for t, (test, likelihood, values) in enumerate(candidate.parts(row)):
            data, modes = test.data, likelihood.modes(values)
            m, n = len(data.modes), len(data.sensors)
            covariance = data.covariance
            if covariance is None:
                sds = [mode.frequency_cov or 0.0 for mode in data.modes]
                sds = [*sds, *np.repeat([mode.shape_sd or 0.0 for mode in data.modes], n)]
                covariance = np.diag(np.square(sds))
            columns = []
            for label, i in test.pairing.items():
                j, mode = data.labels.index(label), data.mode(label)
                columns.append(np.eye(m + m * n)[j])
                self.kinds.append((t, label, i, "frequency", None))
                self.residuals.append(modes.frequencies_hz[0, i - 1] / mode.frequency_hz - 1.0)
                if mode.scored_shape is None:
                    continue
                unit, model = np.nan_to_num(mode.unit_shape), self.unit_model(test, modes, label, i)
                tangent = model - (model @ unit) * unit
                vector = tangent * math.sqrt(2.0 - 2.0 * model @ unit) / np.linalg.norm(tangent)
                seen = np.isfinite(mode.unit_shape)
                plane = np.zeros((seen.sum() - 1, n))
                plane[:, seen] = np.linalg.svd(unit[seen][None])[2][1:]
                turn = rotation(unit, model)
                mean = self.means[label, tuple(seen)]
                turn = rotation(model * np.sign(model @ mean), mean) @ turn * np.sign(model @ mean)
                for direction in plane:
                    column_of_shape = np.zeros(m + m * n)
                    column_of_shape[m + n * j : m + n * (j + 1)] = direction
                    columns.append(column_of_shape)
                    self.kinds.append((t, label, tuple(seen), "shape", turn @ direction))
                    self.residuals.append(direction @ vector)
            own.append(np.array(columns) @ covariance @ np.array(columns).T)
        self.residuals = np.array(self.residuals)
        self.identification = block_diag(*own)
        self.covariance = self.identification + np.array(
            [[self.prediction(a, b) for b in self.kinds] for a in self.kinds]
        )

    @staticmethod
    def unit_model(test, modes, label, i):
        unit = test.data.mode(label).unit_shape
        rows = [test.structure.degrees_of_freedom.index(sensor) for sensor in test.data.sensors]
        model = np.where(np.isfinite(unit), modes.shapes[0, rows, i - 1], 0.0)
        return model / np.linalg.norm(model) * np.sign(model @ np.nan_to_num(unit))

    def mean_shapes(self, candidate, row):
        """Of one mode at the same sensors in all tests, with the sign of the first."""
        sums = {}
        for test, likelihood, values in candidate.parts(row):
            for label, i in test.pairing.items():
                if test.data.mode(label).scored_shape is None:
                    continue
                model = self.unit_model(test, likelihood.modes(values), label, i)
                key = label, tuple(np.isfinite(test.data.mode(label).unit_shape))
                first, total = sums.get(key, (model, np.zeros(len(model))))
                sums[key] = first, total + model * np.sign(model @ first)
        return {key: total / np.linalg.norm(total) for key, (_, total) in sums.items()}

    def prediction(self, a, b):
        if a[3] != b[3]:
            return 0.0
        same_test = a[0] == b[0]
        if a[3] == "shape":
            same = a[1:3] == b[1:3]
            return same * self.ss**2 * (1.0 if same_test else self.tests) * (a[4] @ b[4])
        correlation = self.between ** abs(a[2] - b[2]) * (1.0 if same_test else self.tests)
        return self.sf**2 * (correlation if a[1] == b[1] or not self.by_label else 0.0)

    def log_ratio(self):
        """Of the joint density over the product of those of frequencies and isotropic shapes."""
        variances, groups = self.covariance.diagonal().copy(), {}
        for i, (t, label, _, kind, _) in enumerate(self.kinds):
            if kind == "shape":
                groups.setdefault((t, label), []).append(i)
        for group in groups.values():
            variances[group] = variances[group].mean()
        ratio = multivariate_normal.logpdf(self.residuals, cov=self.covariance)
        return ratio - norm.logpdf(self.residuals, scale=np.sqrt(variances)).sum()
