"""Result of a soak, and its failures."""

from __future__ import annotations

from dataclasses import dataclass, field

from scipy.stats import binom

from harness.memory import Memory

MEMORY_LIMIT_BYTES = 5_000_000
"""Largest growth of a process after the warm-up, bytes."""

PAIR_BYTES = 3_000
"""Memory of the mapping node per recorded pair, bytes."""

FALSE_SWEEPS = 0.01
"""Probability that a converged position is wrong: one minus ``convergence_probability``."""

_CHANCE = 0.001
"""Significance level of the test that sweeps converge falsely more often than that."""

WAITING_LIMIT_S = 1.5
"""Longest wait of a strain vector for its pose, s: above the filter's ``patience_s``."""


@dataclass
class Injection:
    """An injected fault and its outcome.

    Parameters
    ----------
    fault : its name
    at_s : time since the start, s
    reported_s : time until it was reported, s; ``None``: not in time
    recovered_s : time from its end to the recovery, s; ``None``: not in time
    trouble : violated conditions; empty: none
    """

    fault: str
    at_s: float
    reported_s: float | None = None
    recovered_s: float | None = None
    trouble: str = ""


@dataclass
class SoakResult:
    """Result of a soak.

    Parameters
    ----------
    injections : in order
    memory : of each process
    is_warm : whether the soak was long enough to judge the memory
    recorded_pairs : by the mapping node after the warm-up
    late : number of times that a limit was extended because a process waited for a CPU
    sweeps : number of finished sweeps
    judged, converged : posteriors compared with the truth, and those of them that had converged
    wrong : number of false convergences, by the fault that excuses them; empty: none does
    false_sweeps : sweeps that converged falsely though no fault excuses it, one line each, with the reason
    errors_m : errors of the converged posteriors, m
    lag_s : longest lag of a posterior without a fault, s
    waiting_s : longest wait of a strain vector for its pose, s
    queue_bytes : fullest receive queue of the driver, bytes
    ended : reason for an early end; empty if there is none
    tracebacks : logs with a traceback
    """

    injections: list[Injection] = field(default_factory=list)
    memory: dict[str, Memory] = field(default_factory=dict)
    is_warm: bool = False
    recorded_pairs: int = 0
    late: int = 0
    sweeps: int = 0
    judged: int = 0
    converged: int = 0
    wrong: dict[str, int] = field(default_factory=dict)
    false_sweeps: list[str] = field(default_factory=list)
    errors_m: list[float] = field(default_factory=list)
    lag_s: float = 0.0
    waiting_s: float = 0.0
    queue_bytes: int = 0
    ended: str = ""
    tracebacks: list[str] = field(default_factory=list)

    @property
    def failures(self) -> list[str]:
        """Violated conditions, one line each."""
        found = [self.ended] if self.ended else []
        found += [f"{one.fault} at {one.at_s:.0f} s: {one.trouble}" for one in self.injections if one.trouble]
        found += [f"{log}: a traceback" for log in self.tracebacks]
        for name, memory in self.memory.items():
            scan_bytes = PAIR_BYTES * self.recorded_pairs if name == "mapping" else 0
            if self.is_warm and memory.growth_bytes > MEMORY_LIMIT_BYTES + scan_bytes:
                found.append(f"{name}: memory grew by {memory.growth_bytes / 1e6:.1f} MB")
        if self.waiting_s > WAITING_LIMIT_S:
            found.append(f"a strain vector waited {self.waiting_s:.1f} s for its pose")
        count = len(self.false_sweeps)
        if count and binom.sf(count - 1, self.sweeps, FALSE_SWEEPS) < _CHANCE:
            found.append(f"{count} of {self.sweeps} sweeps converged falsely, more than 1 % allows")
        if not self.sweeps or not self.converged:
            found.append(f"{self.sweeps} sweeps, {self.converged} converged posteriors: nothing was tested")
        return found
