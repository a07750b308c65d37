"""The KWIK bound of DOORMAX, counted while it learns (paper, section 6; Diuk, Cohen and Littman 2008, theorem 2).

For one action, attribute and type of effect, DOORMAX answers "I don't know" at most nk + k + 1 times, for n terms and k
effects: every such answer either adds one of at most k effects, or removes one of the n terms from an effect's
condition, or ends in the type's removal. States in which the action fails do not count, as their conditions are
memorised and there can be exponentially many (in n); neither do changes that no effect of the type explains. The
theorem does not bound the steps until the policy is optimal.
"""

from __future__ import annotations

from collections import Counter

from wherry.learning.doormax import Doormax
from wherry.learning.effect_rules import Subject
from wherry.oomdp.effects import effects_between, observed_values
from wherry.oomdp.mdp import Transition


def unknown_answers_bound(terms: int, max_effects: int) -> int:
    """Return the bound nk + k + 1 for one action, attribute and type of effect."""
    return terms * max_effects + max_effects + 1


def attribute_bound(terms: int, max_effects: int, types: int) -> int:
    """Return the bound h(nk + k + 1) + h − 1 for one action and attribute, with h types of effects."""
    return types * unknown_answers_bound(terms, max_effects) + types - 1


class UnknownAnswers:
    """Counts the effects that DOORMAX observes without having predicted them.

    Args:
        learner: The learner.

    Attributes:
        counts: Number of answers "I don't know", by subject and type of effect.
    """

    def __init__(self, learner: Doormax) -> None:
        self.learner = learner
        self.counts: Counter[tuple[Subject, str]] = Counter()

    @property
    def max_count(self) -> int:
        """Largest count for any action, attribute and type."""
        return max(self.counts.values(), default=0)

    @property
    def bound(self) -> int:
        """Bound nk + k + 1 on every count."""
        return unknown_answers_bound(self.learner.domain.size, self.learner.max_effects)

    def observe(self, transition: Transition) -> None:
        """Count the effects of a transition that the learner does not predict; call it before the learner learns them.

        Failures do not count.
        """
        if transition.failed:
            return
        action = transition.action.name
        _, *object_terms = self.learner.domain.conditions(transition.state, transition.action)
        for item, terms in zip(transition.state.objects, object_terms, strict=True):
            for attribute, before, after in observed_values(item, transition.next_state.get(item.name)):
                subject = Subject(action, item.object_class.name, attribute.name)
                if before == after and self.learner.learns_from_changes_alone(subject):
                    continue
                models = self.learner.effect_rules.models[subject]
                for effect in effects_between(attribute, before, after, self.learner.effect_types):
                    if effect.type in models:
                        is_predicted = any(model.covers_terms(terms) for model in models[effect.type].values())
                        self.counts[subject, effect.type] += not is_predicted
