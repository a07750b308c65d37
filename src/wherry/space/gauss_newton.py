"""Gauss–Newton steps of a pose with a Gaussian prior, shared by mapping and localization."""

from __future__ import annotations

import math

import numpy as np

from wherry.kernels import kernel
from wherry.space.pose import Floats


@kernel
def gauss_newton_step(
    pose: Floats, gradient: Floats, information: Floats, prior: Floats, prior_information: Floats, damping: float
) -> Floats:
    """Minimize the linearized residuals plus the squared Mahalanobis distance from the prior.

    Args:
        pose: Pose of the linearization, [3] m, m, rad.
        gradient: Gradient Jᵀ W r of the residuals, [3].
        information: Gauss–Newton Hessian Jᵀ W J of the residuals, [3, 3].
        prior: Mean of the prior, [3] m, m, rad.
        prior_information: Information of the prior, [3, 3].
        damping: Added to the Hessian's diagonal, so that it is regular where residuals and prior leave the pose
            undetermined.

    Returns:
        The step to add to the pose, [3] m, m, rad.
    """
    offset = pose - prior
    offset[2] -= math.tau * np.round(offset[2] / math.tau)
    hessian = information + prior_information + damping * np.eye(3)
    step: Floats = np.zeros(3)
    step[:] = np.linalg.solve(hessian, -(gradient + prior_information @ offset))
    return step
