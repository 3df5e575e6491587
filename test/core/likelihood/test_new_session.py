"""Offset and gain of another session, compared with a linear regression by dense matrices."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.evaluation import Evaluation
from tactile_localizer.core.likelihood.new_session import (
    GAIN_STD,
    OFFSET_VARIANCE,
    NewSession,
)
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM as NU

NODES, CHANNELS, VARIANCE = 20, 4, 1.5
ONE = np.ones(1, bool)


def unmoved(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Ancestors of ``count`` states that do not move."""
    return np.arange(count), np.ones(count)


def session(seed: int = 0) -> tuple[NewSession, np.ndarray]:
    """A session of one phalanx, and the strains (NODES, CHANNELS) that its map expects."""
    mean = 3.0 * np.random.default_rng(seed).standard_normal((NODES, 1, CHANNELS)).astype(np.float32)
    variance = np.full((NODES, 1, 1), VARIANCE, np.float32)
    prior = np.zeros((NODES, 1), np.float32)
    rest = (None, np.zeros((1, CHANNELS)))
    strain_map = StrainMap(np.array([0.0005]), np.array([0.001]), (NODES,), mean, variance, prior, *rest)
    layout = ChannelLayout((CHANNELS,))
    none = np.zeros(CHANNELS)
    noise = NoiseModel(layout, none, np.eye(CHANNELS), np.zeros(1), none, none)
    return NewSession(noise, strain_map, 0.01), mean[:, 0].astype(np.float64)


def nowhere(nodes: np.ndarray) -> Evaluation:
    """The evaluation of a strain that is impossible in the session of the scan."""
    impossible = np.full(len(nodes), -1e6)
    return Evaluation(impossible, impossible, impossible, -1e6, -np.inf, nodes)


def evaluate(
    model: NewSession,
    nodes: np.ndarray,
    felt: np.ndarray,
    exponent: float = 1.0,
    share: float = 1.0,
    same: Evaluation | None = None,
) -> np.ndarray:
    """Ratios of equally probable states that do not move."""
    index, shares = unmoved(len(nodes))
    log_prior = np.full(len(nodes), -np.log(len(nodes)))
    same = nowhere(nodes) if same is None else same
    return model.evaluate((index, share * shares), log_prior, same, felt, ONE, (exponent, exponent), 0.0)


def predicted(first: np.ndarray, second: np.ndarray, felt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a strain at ``second`` after ``felt`` at ``first``, without its noise."""
    design = np.hstack([np.vstack([np.eye(CHANNELS)] * 2), np.concatenate([first, second])[:, None]])
    prior = np.diag([*[OFFSET_VARIANCE] * CHANNELS, GAIN_STD**2])
    joint = design @ prior @ design.T
    before, across = joint[:CHANNELS, :CHANNELS] + VARIANCE * np.eye(CHANNELS), joint[CHANNELS:, :CHANNELS]
    gain = across @ np.linalg.inv(before)
    return second + gain @ (felt - first), joint[CHANNELS:, CHANNELS:] - gain @ across.T


def test_the_density_is_that_of_a_linear_regression() -> None:
    model, means = session()
    first, second = np.array([2, 5, 9]), np.array([3, 6, 10])
    rng = np.random.default_rng(1)
    offset = 5.0 * rng.standard_normal(CHANNELS)
    felt = [offset + means[5] + 0.5, offset + means[6] - 0.5]
    evaluate(model, first, felt[0])
    ratios = evaluate(model, second, felt[1])
    expected = []
    for index in range(3):
        m0, m1 = means[first[index]], means[second[index]]
        start = OFFSET_VARIANCE * np.eye(CHANNELS) + GAIN_STD**2 * np.outer(m0, m0)
        start += VARIANCE * np.eye(CHANNELS)
        residual = felt[0] - m0
        # The sums take the surprise in units of the isotropic part of the predicted variance.
        surprise = residual @ np.linalg.solve(start, residual)
        scale = (NU + surprise) / (NU + CHANNELS)
        mean, covariance = predicted(m0, m1, felt[0])
        density = stats.multivariate_t(mean, covariance + scale * VARIANCE * np.eye(CHANNELS), df=NU)
        constant = gammaln((NU + CHANNELS) / 2) - gammaln(NU / 2) - CHANNELS / 2 * np.log(NU * np.pi)
        expected.append(density.logpdf(felt[1]) - constant)
    # What unknown material says is the same for all of them.
    assert ratios - ratios[0] == pytest.approx(np.array(expected) - expected[0], abs=1e-3)


def test_another_session_begins_with_its_prior_probability() -> None:
    model, means = session()
    likely = np.full(1, 50.0)
    same = Evaluation(likely, likely, np.full(1, -1e6), -1e6, -np.inf, np.array([4]))
    ratio = evaluate(model, same.nodes, means[4], same=same)[0]
    certain = Evaluation(likely + 1.0, likely + 1.0, np.full(1, -1e6), -1e6, -np.inf, np.array([4]))
    model.reset()
    # The scan's session is certain of the strain; the other has next to no density there.
    assert evaluate(model, same.nodes, means[4], same=certain)[0] == pytest.approx(ratio + 1.0, abs=1e-3)


def test_the_offset_is_learned_by_the_exponent() -> None:
    nodes, ratios = np.array([4, 9]), {}
    for exponent in (0.0, 1.0):
        model, means = session()
        evaluate(model, nodes, means[4] + 8.0, exponent)
        right, wrong = evaluate(model, nodes + 1, means[5] + 8.0)
        ratios[exponent] = right - wrong
    assert ratios[1.0] > ratios[0.0] + 2.0


def test_a_new_trajectory_has_no_offset() -> None:
    nodes, differences = np.array([4, 9]), []
    for exponent, share in ((1.0, 0.0), (0.0, 1.0)):
        model, means = session()
        evaluate(model, nodes, means[4] + 8.0, exponent)
        differences.append(np.diff(evaluate(model, nodes, means[4] + 8.0, share=share))[0])
    assert differences[0] == pytest.approx(differences[1])


def test_a_gain_of_zero_is_excluded() -> None:
    """Constant strains are not explained by a map that varies, whatever the offset."""
    model, _ = session()
    ratio = 0.0
    for node in range(NODES):
        felt = 0.1 * np.random.default_rng(node).standard_normal(CHANNELS)
        ratio += evaluate(model, np.array([node]), felt)[0]
    assert ratio < -10.0


def test_a_return_makes_another_session_possible_again() -> None:
    model, means = session()
    likely = np.full(1, 100.0)
    same = Evaluation(likely, likely, np.full(1, -1e6), -1e6, -np.inf, np.array([4]))
    assert model.is_possible
    evaluate(model, same.nodes, means[4], same=same)
    assert not model.is_possible
    model.returned(0.1)
    assert model.is_possible
