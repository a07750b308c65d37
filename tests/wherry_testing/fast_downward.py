"""Plans of Fast Downward for PDDL tasks."""

from __future__ import annotations

from unified_planning.io import PDDLReader
from unified_planning.shortcuts import OneshotPlanner, get_environment

from wherry.oomdp.domain import Action
from wherry.planning.pddl import PddlTask

get_environment().credits_stream = None


def optimal_plan(task: PddlTask) -> list[Action] | None:
    """The shortest plan, by A* with the landmark-cut heuristic; None if there is none."""
    problem = PDDLReader().parse_problem_string(task.domain, task.problem)
    with OneshotPlanner(name="fast-downward-opt") as planner:
        found = planner.solve(problem).plan
    return None if found is None else [task.actions[step.action.name] for step in found.actions]
