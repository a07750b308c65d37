"""The theorem, counted while learning (paper, section 6; Diuk, Cohen and Littman 2008, theorem 2).

For one action, attribute and type of effect, DOORMAX answers "I don't know" at most O(nk + k + 1) times, for n terms
and k effects: every such answer either brings a new effect, of which there are k at most, or takes a term away from a
condition, of which each effect's has n, or ends in the type's removal. States in which the action fails do not count;
these are memorised, and can be exponentially many in n. Nor do changes that no effect of the type could make. It is no
bound on the steps until the policy is optimal.
"""

from __future__ import annotations

from collections import Counter

from wherry.learning.doormax import Doormax
from wherry.learning.predictions import Subject
from wherry.oomdp.effects import effects_between, observed_values
from wherry.oomdp.mdp import Transition


def unknown_answers_bound(terms: int, max_effects: int) -> int:
    """The bound nk + k + 1 for one action, attribute and type of effect."""
    return terms * max_effects + max_effects + 1


def attribute_bound(terms: int, max_effects: int, types: int) -> int:
    """The bound h(nk + k + 1) + h − 1 for one action and attribute, with h types of effects."""
    return types * unknown_answers_bound(terms, max_effects) + types - 1


class UnknownAnswers:
    """How often DOORMAX did not know what it was then shown.

    Args:
        learner: The learner that is being taught.
    """

    def __init__(self, learner: Doormax) -> None:
        self.learner = learner
        self.counts: Counter[tuple[Subject, str]] = Counter()

    @property
    def most(self) -> int:
        """The count of the action, attribute and type for which it is largest."""
        return max(self.counts.values(), default=0)

    @property
    def bound(self) -> int:
        """What none of the counts may exceed."""
        return unknown_answers_bound(self.learner.domain.size, self.learner.max_effects)

    def observe(self, transition: Transition) -> None:
        """Ask what the learner knows of an experience, just before it learns from that; failures do not count."""
        if transition.failed:
            return
        action = transition.action.name
        _, *own = self.learner.domain.conditions(transition.state, transition.action)
        for item, terms in zip(transition.state.objects, own, strict=True):
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):
                subject = Subject(action, item.object_class.name, attribute.name)
                if before == after and self.learner.from_changes_alone(subject):
                    continue
                alive = self.learner.predictions.models[subject]
                for effect in effects_between(attribute, before, after, self.learner.effect_types):
                    if effect.type in alive:
                        known = any(model.covers_terms(terms) for model in alive[effect.type].values())
                        self.counts[subject, effect.type] += not known
