"""What came of a soak, and what of it must not happen."""

from __future__ import annotations

from dataclasses import dataclass, field

from harness.memory import Memory

MEMORY_LIMIT_BYTES = 5_000_000
"""Most that a process may grow by after the warm-up."""

PAIR_BYTES = 3_000
"""Memory for a pair of the scan in the mapping node, which makes a map of up to 20,000 of them, bytes."""

WAITING_LIMIT_S = 1.5
"""Longest that a strain vector may wait for its pose: the filter's patience, and some."""


@dataclass
class Injection:
    """A fault that was injected, and what came of it.

    Parameters
    ----------
    fault : its name
    at_s : when, since the start
    told_s : how long it took to show; ``None``: it did not
    well_s : how long after its end all was well; ``None``: it was not in time
    trouble : what was wrong
    """

    fault: str
    at_s: float
    told_s: float | None = None
    well_s: float | None = None
    trouble: str = ""


@dataclass
class SoakResult:
    """What came of a soak.

    Parameters
    ----------
    injections : in their order
    memory : of each process
    is_warm : whether the soak was long enough to judge the memory
    recorded_pairs : by the mapping node after the warm-up
    late : times that a fault took longer than its limit to show or to be over, for want of a processor
    sweeps : that the hand finished
    judged, believed : posteriors compared with the truth, and those of them that were converged
    wrong : number of false convergences, by the fault that excuses them; empty: none does
    examples : the first false convergences that no fault excuses, one line each, with their reasons
    errors_m : of the converged ones
    lag_s : longest that a posterior was behind while all was well
    waiting_s : longest that a strain vector waited for its pose
    queue_bytes : most in the driver's receive queue
    ended : why the soak ended before its time; empty: it did not
    tracebacks : logs that have one
    """

    injections: list[Injection] = field(default_factory=list)
    memory: dict[str, Memory] = field(default_factory=dict)
    is_warm: bool = False
    recorded_pairs: int = 0
    late: int = 0
    sweeps: int = 0
    judged: int = 0
    believed: int = 0
    wrong: dict[str, int] = field(default_factory=dict)
    examples: list[str] = field(default_factory=list)
    errors_m: list[float] = field(default_factory=list)
    lag_s: float = 0.0
    waiting_s: float = 0.0
    queue_bytes: int = 0
    ended: str = ""
    tracebacks: list[str] = field(default_factory=list)

    @property
    def failures(self) -> list[str]:
        """What must not happen and did, a line each."""
        found = [self.ended] if self.ended else []
        found += [f"{one.fault} at {one.at_s:.0f} s: {one.trouble}" for one in self.injections if one.trouble]
        found += [f"{log}: a traceback" for log in self.tracebacks]
        for name, memory in self.memory.items():
            scan_bytes = PAIR_BYTES * self.recorded_pairs if name == "mapping" else 0
            if self.is_warm and memory.growth_bytes > MEMORY_LIMIT_BYTES + scan_bytes:
                found.append(f"{name}: memory grew by {memory.growth_bytes / 1e6:.1f} MB")
        if self.waiting_s > WAITING_LIMIT_S:
            found.append(f"a strain vector waited {self.waiting_s:.1f} s for its pose")
        found += [f"false convergence: {example}" for example in self.examples]
        if not self.sweeps or not self.believed:
            found.append(f"{self.sweeps} sweeps, {self.believed} converged posteriors: nothing was shown")
        return found
