"""Conditions: strings over {0, 1, *}, one symbol per term, stored as two bit masks (paper, section 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True, slots=True)
class Condition:
    """A conjunction of terms and negated terms, c ∈ {0, 1, *}ⁿ.

    Bit i stands for term i, whose symbol is the i-th from the left in the printed condition.

    Attributes:
        size: n, the number of terms.
        mask: Bits of the terms that the condition fixes; all others are ``*``.
        value: Bits of the fixed terms that must hold; bits outside the mask are 0.
    """

    size: int
    mask: int
    value: int

    @classmethod
    def of(cls, size: int, terms: int) -> Self:
        """The condition cond(s) of a state in which exactly these terms hold, given as bits."""
        return cls(size, (1 << size) - 1, terms)

    @classmethod
    def parse(cls, text: str) -> Self:
        """Parse a condition as it is printed: ``1**0*0*``.

        Raises:
            ValueError: The text contains another character than 0, 1 and *.
        """
        if set(text) - set("01*"):
            raise ValueError(f"a condition consists of 0, 1 and *, not {text!r}")
        mask = sum(1 << index for index, symbol in enumerate(text) if symbol != "*")
        value = sum(1 << index for index, symbol in enumerate(text) if symbol == "1")
        return cls(len(text), mask, value)

    def __str__(self) -> str:
        return "".join(
            "*" if not self.mask >> index & 1 else str(self.value >> index & 1) for index in range(self.size)
        )

    def merge(self, other: Condition) -> Condition:
        """c1 ⊕ c2: the terms that both fix to the same value."""
        mask = self.mask & other.mask & ~(self.value ^ other.value)
        return Condition(self.size, mask, self.value & mask)

    def covers(self, other: Condition) -> bool:
        """c1 ⊨ c2 in the paper's notation: whether this condition is at least as general as the other."""
        return not self.mask & ~other.mask and not (self.value ^ other.value) & self.mask

    def covers_terms(self, terms: int) -> bool:
        """Whether c ⊨ cond(s), with cond(s) given as bits."""
        return not (self.value ^ terms) & self.mask

    @property
    def literal_count(self) -> int:
        """Number of terms that the condition fixes."""
        return self.mask.bit_count()

    def describe(self, names: Sequence[str]) -> str:
        """The condition as text: ``touch_N(robot, wall) and not box.in_bot``; "always" if it fixes no term."""
        parts = [
            name if self.value >> index & 1 else f"not {name}"
            for index, name in enumerate(names)
            if self.mask >> index & 1
        ]
        return " and ".join(parts) or "always"
