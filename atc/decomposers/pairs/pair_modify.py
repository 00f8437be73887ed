"""``pair_modify``: shifts, mixing rules, tables, and weights of a sub-style's own."""

from __future__ import annotations

from dataclasses import replace

from ...errors import AtcError
from ..registry import Modify
from .input import MIX_RULES


def apply_modify(modify: Modify, lines) -> Modify:
    """`modify` after the words of pair_modify lines."""
    for words, where in lines:
        k = 0
        while k < len(words):
            key, value = words[k], words[k + 1] if k + 1 < len(words) else None
            if value is None and key != "nofdotr":
                raise AtcError(f"{where}: pair_modify {key} needs a value")
            if key == "shift":
                modify = replace(modify, shift=_yes(value, f"{where}: pair_modify shift"))
            elif key == "mix":
                if value not in MIX_RULES:
                    raise AtcError(f"{where}: pair_modify mix {value}: expected one of {', '.join(MIX_RULES)}")
                modify = replace(modify, mix=value)
            elif key == "compute":
                modify = replace(modify, compute=_yes(value, f"{where}: pair_modify compute"))
            elif key == "special":
                which, weights = value, words[k + 2 : k + 5]
                if which not in ("lj", "coul", "lj/coul") or len(weights) != 3:
                    raise AtcError(
                        f"{where}: pair_modify special: expected lj, coul or lj/coul and three weights, got "
                        f"{' '.join(words[k + 1 : k + 5])}"
                    )
                modify = replace(modify, special=(*modify.special, (which, *weights)))
                k += 3
            elif key == "table":
                if not value.isdecimal() or len(value) > 2:
                    raise AtcError(f"{where}: pair_modify table: expected a number of bits such as 12, got {value}")
                modify = replace(modify, table=int(value))
            elif key in ("table/disp", "tabinner", "tabinner/disp", "tail", "neigh/trim", "compute/tally"):
                # table*: only for long-range Coulomb. tail: constants added to energy and pressure, no forces.
                if key == "tail" and _yes(value, f"{where}: pair_modify tail"):
                    modify = replace(modify, tail=True)
            elif key == "nofdotr":
                k -= 1
            else:
                raise AtcError(
                    f"{where}: pair_modify {key} is not supported: expected shift, mix, table, tail, compute, special"
                )
            k += 2
    return modify


def _yes(word, what) -> bool:
    if word in ("yes", "on", "true"):
        return True
    if word in ("no", "off", "false"):
        return False
    raise AtcError(f"{what}: expected yes or no, got {word!r}")
