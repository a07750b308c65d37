from .attributes import Attribute, AttributeKind, boolean, enumeration, integer, real
from .conditional_models import ConditionalModel, ConditionalOutcome, ConditionalPrediction, PerStateModel
from .conditions import Condition
from .domain import Action, Domain
from .effects import EFFECT_TYPES, PAPER_TYPES, Effect, EffectType
from .effects_outcome import EffectsOutcome, GivenTask, StepReward
from .mdp import (
    IMPOSSIBLE,
    UNKNOWN,
    DeterministicMdp,
    Environment,
    Learner,
    Model,
    Outcome,
    Prediction,
    RewardFunction,
    TerminationFunction,
    Transition,
)
from .objects import Object, ObjectClass, Scene, State
from .relations import DIRECTIONS, ON, TOUCH, TOUCH_EDGE, Relation
from .state_json import state_from_json
from .terms import Term, attribute_holds, attribute_is, property_holds, related

__all__ = [
    "DIRECTIONS",
    "EFFECT_TYPES",
    "IMPOSSIBLE",
    "ON",
    "PAPER_TYPES",
    "TOUCH",
    "TOUCH_EDGE",
    "UNKNOWN",
    "Action",
    "Attribute",
    "AttributeKind",
    "Condition",
    "ConditionalModel",
    "ConditionalOutcome",
    "ConditionalPrediction",
    "DeterministicMdp",
    "Domain",
    "Effect",
    "EffectType",
    "EffectsOutcome",
    "Environment",
    "GivenTask",
    "Learner",
    "Model",
    "Object",
    "ObjectClass",
    "Outcome",
    "PerStateModel",
    "Prediction",
    "Relation",
    "RewardFunction",
    "Scene",
    "State",
    "StepReward",
    "Term",
    "TerminationFunction",
    "Transition",
    "attribute_holds",
    "attribute_is",
    "boolean",
    "enumeration",
    "integer",
    "property_holds",
    "real",
    "related",
    "state_from_json",
]
