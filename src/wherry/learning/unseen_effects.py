"""The probability that an action has an effect not observed so far, given the conditions under which it was tried."""

from __future__ import annotations

from collections.abc import Iterable

from wherry.learning.conjunctions import ConjunctionPosterior

UNSEEN_END_PRIOR = 0.01  # prior probability that an action can end the episode
MAX_CONDITIONS = 100  # most recent conditions of an action that the estimate uses; its time grows with their number


class UnseenEffects:
    """Estimates the probability that an action has an effect not observed so far.

    An action without any observed effect is assumed to have one under some conjunction. The posterior over that
    conjunction, given the conditions under which the action failed, favours conditions unlike these.
    The end of the episode is estimated in the same way until an episode has ended. Otherwise all known steps could have
    the same reward, and an agent would have no reason to try others.

    Args:
        actions: Names of the actions.
        size: n, the number of terms.
        literal_odds: q, prior odds that a conjunction contains a literal.
        novelty: Probability that an action whose effects are known has a further effect, not observed so far.

    Attributes:
        tried: For each action, the conditions (bits) under which it was tried, the latest last, each with whether the
            action ever had an effect under it.
    """

    def __init__(self, actions: Iterable[str], size: int, literal_odds: float, novelty: float) -> None:
        self.novelty = novelty
        self.tried: dict[str, dict[int, bool]] = {action: {} for action in actions}
        self._size = size
        self._literal_odds = literal_odds
        self._posteriors: dict[str, ConjunctionPosterior] = {}  # given that all conditions tried are negative examples

    def add(self, action: str, terms: int, *, succeeded: bool) -> bool:
        """Add one trial of an action; return whether probabilities may have changed."""
        tried = self.tried[action]
        is_new = terms not in tried or (succeeded and not any(tried.values()))
        tried[terms] = tried.get(terms, False) or succeeded
        if is_new:
            self._posteriors.pop(action, None)
        return is_new

    def probability(self, action: str, terms: int, *, is_end_unseen: bool) -> float:
        """Return the probability of an effect not observed so far, under one condition.

        Args:
            action: Name of the action.
            terms: Terms that hold, as bits.
            is_end_unseen: Whether the end of episodes is to be learnt and was not observed so far.
        """
        tried = self.tried[action]
        if terms in tried:
            return 0.0
        if not any(tried.values()):
            return self._untried_probability(action, terms)
        if is_end_unseen:
            return max(self.novelty, UNSEEN_END_PRIOR * self._untried_probability(action, terms))
        return self.novelty

    def invalidate(self) -> None:
        """Drop all cached estimates, after `tried` was changed."""
        self._posteriors.clear()

    def _untried_probability(self, action: str, terms: int) -> float:
        """Return the probability that a conjunction holds under a condition, given that it held under none tried."""
        if action not in self._posteriors:
            latest = [*self.tried[action]][-MAX_CONDITIONS:]
            self._posteriors[action] = ConjunctionPosterior.of(self._size, self._literal_odds, (), latest)
        return self._posteriors[action].probability(terms)
