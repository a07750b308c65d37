"""How likely an action has an effect that was never observed, given the conditions under which it was tried."""

from __future__ import annotations

from collections.abc import Iterable

from wherry.learning.concepts import Concept

UNSEEN_END_PRIOR = 0.01  # probability that an end of the episode not seen yet lies behind untried conditions
MAX_CONDITIONS = 100  # latest conditions of an action that count; more would make the estimate slow


class UnseenEffects:
    """Estimates the probability that an action does something that it was never seen to do.

    An action that never had an effect needs some conjunction, which is likeliest to hold where the least was tried.
    The same goes for the end of episodes until one has ended: where all steps seem to be worth the same, nothing else
    would make an agent try another.

    Args:
        actions: Names of the actions.
        size: n, the number of terms.
        factor: q, prior odds of each literal of a conjunction.
        novelty: Probability that an action whose effects are known has another one.

    Attributes:
        tried: Whether each action ever had an effect, by the terms that held (bits), the latest condition last.
    """

    def __init__(self, actions: Iterable[str], size: int, factor: float, novelty: float) -> None:
        self.novelty = novelty
        self.tried: dict[str, dict[int, bool]] = {action: {} for action in actions}
        self._size = size
        self._factor = factor
        self._untried: dict[str, Concept] = {}

    def add(self, action: str, terms: int, *, succeeded: bool) -> bool:
        """Add one trial of an action; return whether probabilities may have changed."""
        tried = self.tried[action]
        is_news = terms not in tried or (succeeded and not any(tried.values()))
        tried[terms] = tried.get(terms, False) or succeeded
        if is_news:
            self._untried.pop(action, None)
        return is_news

    def probability(self, action: str, terms: int, *, is_end_unseen: bool) -> float:
        """Return the probability of an effect never observed where exactly these terms hold.

        Args:
            action: Name of the action.
            terms: Terms that hold, as bits.
            is_end_unseen: Whether the end of episodes has to be learnt and was never seen.
        """
        tried = self.tried[action]
        if terms in tried:
            return 0.0
        if not any(tried.values()):
            return self._holds_untried(action, terms)
        if is_end_unseen:
            return max(self.novelty, UNSEEN_END_PRIOR * self._holds_untried(action, terms))
        return self.novelty

    def invalidate(self) -> None:
        """Drop all cached estimates, after `tried` was changed."""
        self._untried.clear()

    def _holds_untried(self, action: str, terms: int) -> float:
        """Return the probability that a conjunction holds here that held under none of the tried conditions."""
        if action not in self._untried:
            self._untried[action] = Concept.of(self._size, self._factor, (), [*self.tried[action]][-MAX_CONDITIONS:])
        return self._untried[action].probability(terms)
