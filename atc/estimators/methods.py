"""How the sums of a frame are taken, deposit by deposit, and what to do when the error found is larger than the one
allowed."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

#: The deposits a frame may need: Σ a φ over atoms, Σ b β over bonds, Σ b β between reference positions, and Σ a φ with
#: Σ a ∂φ/∂x over atoms, where they are now and where they were in the reference frame.
DEPOSITS = ("site", "bond", "reference_bond", "gather", "reference_gather")
NAMES = {
    "site": "sums over atoms",
    "bond": "sums over bonds",
    "reference_bond": "sums over bonds of the reference frame",
    "gather": "sums over atoms for gradients",
    "reference_gather": "sums over atoms of the reference frame for gradients",
}


@dataclass(frozen=True)
class Method:
    """One way to take the sums of one deposit.

    name : "direct", "spectral" or "slab"
    tolerance : of the spectral method (0: exact)
    reason : why it was chosen
    rungs : tolerances to go on with when the error turns out too large; after the last one, the exact sum
    order, orders : of the moments that atoms carry in place of their bonds (see `atc.deposit.moments`), now and at each
        rung; None: bonds become points
    forced : asked for by name, so that no other method may take its place
    """

    name: str = "direct"
    tolerance: float = 0.0
    reason: str = "the exact sum: keeps every tolerance"
    rungs: tuple[float, ...] = ()
    forced: bool = False
    order: int | None = None
    orders: tuple[int | None, ...] = ()

    @property
    def exact(self) -> bool:
        return self.name != "spectral"

    def tightened(self, error: float, goal: float) -> Method:
        """The cheapest next rung that can be expected to bring `error` well below `goal`; itself if there is nothing
        left to try."""
        if self.exact:
            return self
        for k, rung in enumerate(self.rungs):
            # The error follows the tolerance, roughly.
            if error * rung <= 0.5 * goal * self.tolerance:
                return self._rung(k)
        if self.forced:
            return self._rung(len(self.rungs) - 1) if self.rungs else self
        return self.exactly(f"tolerance {self.tolerance:g} of the spectral method left an error of {error:.1e}")

    def _rung(self, k: int) -> Method:
        order = self.orders[k] if self.orders else None
        return replace(
            self, tolerance=self.rungs[k], rungs=self.rungs[k + 1 :], order=order, orders=self.orders[k + 1 :]
        )

    def looser_than(self, other: Method) -> bool:
        return not self.exact and (other.exact or other.tolerance < self.tolerance)

    def exactly(self, reason: str) -> Method:
        return Method("direct", reason=reason)

    def __str__(self):
        return self.name if self.exact else f"{self.name} to {self.tolerance:.3g}"

    # --- as JSON can hold it
    def plain(self) -> dict:
        return {**asdict(self), "rungs": list(self.rungs), "orders": list(self.orders)}

    @classmethod
    def from_plain(cls, values: dict) -> Method:
        return cls(**{**values, "rungs": tuple(values["rungs"]), "orders": tuple(values.get("orders", ()))})


EXACT = Method()


@dataclass(frozen=True)
class Refinement:
    """That something was computed again, and why. error : the one that was found, None where none had to be; what : the
    rest of the sentence"""

    what: str
    error: float | None = None

    def __str__(self):
        return self.what if self.error is None else f"error {self.error:.1e} of {self.what}"

    def then(self, what: str) -> Refinement:
        """The same, with what was done about it."""
        return replace(self, what=f"{self.what}: {what}")

    # --- as JSON can hold it
    def plain(self) -> dict:
        return {"what": self.what, "error": self.error}

    @staticmethod
    def summary(of: list[tuple[int, dict]]) -> str:
        """What was computed again in which frames, like by like, with the largest error that was the cause; of :
        (frame, `plain`)."""
        like: dict = {}
        for k, plain in of:
            frames, errors = like.setdefault((plain["what"], plain["error"] is None), ([], []))
            frames.append(k)
            errors.append(plain["error"])
        return "; ".join(
            f"frame{'s' * (len(frames) > 1)} {ranges(frames)}: "
            + (what if unmeasured else f"error{' up to' * (len(errors) > 1)} {max(errors):.1e} of {what}")
            for (what, unmeasured), (frames, errors) in like.items()
        )


def ranges(numbers) -> str:
    """1, 2, 3, 7 as "1-3, 7"."""
    out: list[list[int]] = []
    for k in sorted(set(numbers)):
        if out and k == out[-1][1] + 1:
            out[-1][1] = k
        else:
            out.append([k, k])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in out)


def summary(methods: dict[str, Method]) -> str:
    """One word where all deposits go one way, else which goes which way."""
    names = list(dict.fromkeys(m.name for m in methods.values()))
    if len(names) <= 1:
        return names[0] if names else "direct"
    return "; ".join(f"{NAMES[key]}: {m.name}" for key, m in methods.items())


def details(methods: dict[str, Method]) -> str:
    """Methods and their reasons in one line."""
    return "; ".join(f"{NAMES[key]}: {m} ({m.reason})" for key, m in methods.items())


def deposits_of(quantity, work) -> tuple[str, ...]:
    """The deposits that a quantity of some work is made of."""
    prefix = "reference_" if quantity.on_reference else ""
    of = (
        ("site" if work.summed_site else "gather", quantity.site),
        (prefix + "bond", quantity.bond),
        (prefix + "gather", quantity.gather),
    )
    return tuple(dict.fromkeys(key for key, sums in of if sums))
