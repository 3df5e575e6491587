"""A position is believed when the belief is narrow and there is evidence, both for a while."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactile_localizer.core.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.filters.belief import Belief

CRITERIA = ConvergenceCriteria(std=np.array([0.002, 0.004]), evidence=6.0, sustain=0.002)
NARROW = Belief(np.zeros(2), np.diag([0.001**2, 0.002**2]), 50.0, 75)
WIDE = Belief(np.zeros(2), np.diag([0.01**2, 0.01**2]), 50.0, 75)


def after(updates, convergence=None):
    convergence = convergence or Convergence(CRITERIA)
    for belief, log_ratio in updates:
        convergence.update(belief, 4.0 * log_ratio, 0.0005)
    return convergence


def test_a_narrow_belief_with_evidence_for_a_while_is_believed():
    convergence = after([(NARROW, 5.0)] * 3)
    assert not convergence.converged
    assert convergence.reason == "not converged: held for 0.5 of 2.0 mm"
    after([(NARROW, 5.0)] * 3, convergence)
    assert convergence.converged
    assert convergence.reason.startswith("converged: variances 0.25 of the threshold, evidence 14.5 nats")


@pytest.mark.parametrize(
    ("update", "reason"),
    [
        ((NARROW, 0.0), "not converged: evidence 0.0 of 6.0 nats"),
        ((NARROW, -50.0), "not converged: evidence 0.0 of 6.0 nats"),
        ((WIDE, 5.0), "not converged: variances 15.6 times the threshold"),
    ],
)
def test_neither_alone_is_enough(update, reason):
    """The paper's finding: a narrow belief alone, or a good explanation alone, is not yet contact."""
    convergence = after([update] * 100)
    assert not convergence.converged
    assert convergence.reason == reason


def test_an_interruption_starts_the_while_anew():
    convergence = after([(NARROW, 20.0)] * 3 + [(WIDE, 20.0)] + [(NARROW, 20.0)] * 3)
    assert not convergence.converged


def test_past_the_feature_it_stays_believed_on_no_news():
    convergence = after([(NARROW, 10.0)] * 10 + [(NARROW, 0.0)] * 1000)
    assert convergence.converged


def test_on_featureless_material_chance_alone_gathers_no_evidence():
    """A map that blurs explains the tails better, and has credit in the bulk: no log-ratio is negative."""
    sharp, blurred = stats.norm(0.0, 1.0), stats.norm(0.0, 1.4)
    strains = sharp.rvs((200, 100, 16), random_state=np.random.default_rng(1))
    log_ratios = np.maximum(blurred.logpdf(strains).sum(axis=2) - sharp.logpdf(strains).sum(axis=2), 0.0)
    believed = 0
    for sweep in log_ratios:
        convergence = Convergence(CRITERIA)
        for log_ratio in sweep:
            convergence.update(NARROW, log_ratio, 0.004)
        believed += convergence.converged
    assert log_ratios.sum(axis=1).mean() > 2.0 * CRITERIA.evidence
    assert believed <= 0.05 * len(log_ratios)


def test_it_is_lost_when_what_is_felt_contradicts():
    convergence = after([(NARROW, 10.0)] * 10)
    reasons = [after([(NARROW, -10.0)], convergence).reason for _ in range(20)]
    assert "lost: the evidence for the believed place is gone" in reasons
    assert not convergence.converged


def test_it_is_lost_when_the_belief_spreads():
    convergence = after([(NARROW, 10.0)] * 10 + [(WIDE, 0.0)])
    assert not convergence.converged
    assert convergence.reason == "lost: variances 15.6 times the threshold"


def test_it_is_kept_where_the_belief_widens_a_little():
    little = Belief(np.zeros(2), np.diag(1.5 * CRITERIA.std**2), 50.0, 75)
    assert after([(NARROW, 10.0)] * 10 + [(little, 1.0)] * 10).converged


def test_what_was_lost_can_be_found_again():
    convergence = after([(NARROW, 10.0)] * 10 + [(NARROW, -10.0)] * 10 + [(NARROW, 10.0)] * 10)
    assert convergence.converged


def test_one_wild_strain_cannot_make_or_break_it():
    assert not after([(NARROW, 1e9)]).converged
    assert after([(NARROW, 10.0)] * 10 + [(NARROW, -1e9)]).converged
    assert after([(NARROW, 10.0)] * 10 + [(NARROW, -math.inf)]).converged


@given(st.lists(st.tuples(st.sampled_from([NARROW, WIDE]), st.floats(-1e6, 1e6)), max_size=60))
def test_whatever_is_felt_the_evidence_is_bounded_and_the_reason_given(updates):
    convergence = after(updates)
    assert 0.0 <= convergence.evidence <= 18.0
    assert convergence.reason.startswith(("converged", "not converged", "lost"))
    assert convergence.converged == convergence.reason.startswith("converged")


def test_a_reset_forgets():
    convergence = after([(NARROW, 10.0)] * 10)
    convergence.reset()
    assert not convergence.converged
    assert convergence.evidence == 0.0
    assert not after([(NARROW, 5.0)], convergence).converged
