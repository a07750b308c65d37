"""The parameters of Monte Carlo localization, with the names and defaults of nav2's amcl."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.space.pose import IDENTITY, MAX_COORDINATE, Pose

ROBOT_MODELS = ("differential", "omnidirectional")
LASER_MODELS = ("likelihood_field", "likelihood_field_prob", "beam")
MAX_PARTICLES_LIMIT = 10_000_000  # upper limit of max_particles, about 1 GB of memory
LOST_PROBABILITY_THRESHOLD = 0.5  # probability of being lost above which a robot is reported as lost
GLOBAL_MAX_PARTICLES = 50_000  # particles at a global start, of which KLD sampling soon drops most
KNOWN_START_COVARIANCE = np.diag([0.1**2, 0.1**2, 0.05**2])  # m², m², rad², of a start pose from a reference

# Names of parameters by the range of their values
FRACTIONS = (
    "z_hit",
    "z_short",
    "z_max",
    "z_rand",
    "beam_skip_threshold",
    "beam_skip_error_threshold",
    "recovery_alpha_slow",
    "recovery_alpha_fast",
    "least_effective",
)
NON_NEGATIVE = (
    "alpha1",
    "alpha2",
    "alpha3",
    "alpha4",
    "alpha5",
    "update_min_d",
    "update_min_a",
    "lambda_short",
    "robot_radius",
    "turn_slip",
)
POSITIVE = (
    "sigma_hit",
    "laser_likelihood_max_dist",
    "pf_err",
    "pf_z",
    "refine_sigma",
    "beam_skip_distance",
    "max_odometry_speed",
    "independent_beams",
)


@dataclass(frozen=True, slots=True)
class AmclParameters:
    """Parameters of the filter. The defaults are nav2's; those under "Beyond amcl" do not exist there.

    Attributes:
        alpha1: Variance of odometry's rotation per squared rotation, rad²/rad².
        alpha2: Variance of odometry's rotation per squared translation, rad²/m².
        alpha3: Variance of odometry's translation per squared translation, m²/m².
        alpha4: Variance of odometry's translation per squared rotation, m²/rad².
        alpha5: Variance of odometry's sideways translation per squared translation, m²/m²; omnidirectional robots only.
        robot_model_type: One of ROBOT_MODELS, the keys of `motion.MOTION_MODELS`.
        laser_model_type: One of LASER_MODELS, the keys of `sensor.SENSOR_MODELS`.
        max_beams: Number of evenly spaced beams of a scan in the measurement model.
        laser_min_range: Lower limit of the ranges that are used, m; the scan's own limit applies where it is larger.
        laser_max_range: Upper limit of the ranges that are used, m; the scan's own limit applies where it is smaller,
            and alone if this one is not positive.
        laser_likelihood_max_dist: Distance at which the likelihood field is truncated, m.
        z_hit: Mixture weight of readings of mapped obstacles.
        z_short: Mixture weight of readings cut short by unmapped obstacles (beam model).
        z_max: Mixture weight of maximum-range readings (beam model).
        z_rand: Mixture weight of random readings.
        sigma_hit: Standard deviation σ of readings of mapped obstacles, m.
        lambda_short: Decay rate λ of short readings with distance, 1/m (beam model).
        beam_skip_distance: Distance from the nearest obstacle within which a beam's end agrees with a particle, m.
        beam_skip_threshold: Fraction of the particles that must agree with a beam; otherwise it is skipped.
        beam_skip_error_threshold: Fraction of skipped beams above which no beam is skipped.
        min_particles: Lower limit of the number of particles.
        max_particles: Upper limit of the number of particles.
        pf_err: Bound ε on the Kullback-Leibler distance between the sampled and the true distribution (KLD sampling).
        pf_z: Upper standard normal quantile of the probability that ``pf_err`` holds (KLD sampling).
        resample_interval: Number of filter updates from one resampling to the next.
        selective_resampling: Whether to resample only if the effective sample size is below half of the particles.
        update_min_d: Translation that triggers a filter update, m.
        update_min_a: Rotation that triggers a filter update, rad.
        recovery_alpha_slow: Decay rate of the slow average likelihood per update, 0 to 1; 0 turns random particles off.
        recovery_alpha_fast: Decay rate of the fast average likelihood per update, 0 to 1.
        set_initial_pose: Whether ``initial_pose`` is known to be where the robot starts.
        initial_pose: Initial pose of base_link, map frame.
        initial_covariance: [3] variances of the initial pose, m², m², rad².

    Beyond amcl:
        independent_beams: Number of independent readings that the ``max_beams`` beams are worth, since the errors of
            neighbouring beams are correlated.
        least_effective: Lower limit of the effective sample size after a scan, as a fraction of the particles. The
            likelihood of the scan is tempered to keep it, as a multi-modal posterior would collapse too early.
        refine: Whether the estimate is matched to the map with all beams before it is reported.
        refine_sigma: Standard deviation σ of the matched beam ends around the map's obstacles, m.
        robot_radius: Radius around base_link within which readings are dropped as being of the robot's load, m.
        turn_slip: Standard deviation of the sideways shift of a differential robot's base_link per rotation, m/rad,
            since the odometry's reference point is not exactly the centre of rotation.
        max_odometry_speed: Speed above which a change of the odometry's pose is a jump of the odom frame, m/s.
    """

    alpha1: float = 0.2
    alpha2: float = 0.2
    alpha3: float = 0.2
    alpha4: float = 0.2
    alpha5: float = 0.2
    robot_model_type: str = "differential"
    laser_model_type: str = "likelihood_field"
    max_beams: int = 60
    laser_min_range: float = -1.0
    laser_max_range: float = 100.0
    laser_likelihood_max_dist: float = 2.0
    z_hit: float = 0.5
    z_short: float = 0.05
    z_max: float = 0.05
    z_rand: float = 0.5
    sigma_hit: float = 0.2
    lambda_short: float = 0.1
    beam_skip_distance: float = 0.5
    beam_skip_threshold: float = 0.3
    beam_skip_error_threshold: float = 0.9
    min_particles: int = 500
    max_particles: int = 2000
    pf_err: float = 0.05
    pf_z: float = 0.99
    resample_interval: int = 1
    selective_resampling: bool = False
    update_min_d: float = 0.25
    update_min_a: float = 0.2
    recovery_alpha_slow: float = 0.0
    recovery_alpha_fast: float = 0.0
    set_initial_pose: bool = False
    initial_pose: Pose = IDENTITY
    initial_covariance: tuple[float, float, float] = (0.25, 0.25, (math.pi / 12) ** 2)
    independent_beams: float = 15.0
    least_effective: float = 0.3
    refine: bool = True
    refine_sigma: float = 0.05
    robot_radius: float = 0.0
    turn_slip: float = 0.0
    max_odometry_speed: float = 10.0

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            InputError: A value is out of its range.
        """
        for name, is_valid, reason in self._checks():
            if not is_valid:
                raise InputError("amcl parameters", name, f"{getattr(self, name)!r} {reason}")

    def _checks(self) -> list[tuple[str, bool, str]]:
        """Field name, whether its value is valid, and the requirement it fails if not."""
        return [
            *((name, 0.0 <= getattr(self, name) <= 1.0, "is not between 0 and 1") for name in FRACTIONS),
            *((name, 0.0 <= getattr(self, name) < math.inf, "must not be negative") for name in NON_NEGATIVE),
            *((name, 0.0 < getattr(self, name) < math.inf, "must be positive") for name in POSITIVE),
            ("laser_min_range", math.isfinite(self.laser_min_range), "is not finite"),
            ("laser_max_range", math.isfinite(self.laser_max_range), "is not finite"),
            ("z_hit", self.z_hit > 0.0, "must be positive"),
            (
                "z_rand",
                self.z_rand > 0.0,
                "must be positive, or a single outlier reading would make every pose impossible",
            ),
            ("max_beams", self.max_beams >= 2, "is fewer than 2"),
            ("min_particles", self.min_particles >= 1, "is fewer than 1"),
            ("max_particles", self.max_particles >= self.min_particles, "is below min_particles"),
            ("max_particles", self.max_particles <= MAX_PARTICLES_LIMIT, f"is more than {MAX_PARTICLES_LIMIT:,}"),
            ("resample_interval", self.resample_interval >= 1, "is fewer than 1"),
            ("robot_model_type", self.robot_model_type in ROBOT_MODELS, f"is none of {', '.join(ROBOT_MODELS)}"),
            ("laser_model_type", self.laser_model_type in LASER_MODELS, f"is none of {', '.join(LASER_MODELS)}"),
            (
                "initial_pose",
                all(abs(value) <= MAX_COORDINATE for value in self.initial_pose.as_array()),
                f"is not finite, or beyond {MAX_COORDINATE:g} m",
            ),
            ("initial_covariance", all(0.0 <= v < math.inf for v in self.initial_covariance), "must not be negative"),
        ]


PRECISE_PARAMETERS = AmclParameters(
    alpha1=0.05,
    alpha2=0.05,
    alpha3=0.05,
    alpha4=0.05,
    sigma_hit=0.1,
    update_min_d=0.1,
    update_min_a=0.1,
    refine_sigma=0.03,
    robot_radius=0.2,
)
"""For a robot with accurate odometry and lidar on a map of its own: errors of 1 cm, where the defaults give 2 to 3 cm
because unmapped objects near the walls bias the estimate."""

LOG_PARAMETERS = AmclParameters(
    alpha1=0.0225, alpha2=0.005, alpha3=0.0225, alpha4=0.0025, turn_slip=0.07, z_hit=0.1, z_rand=0.9
)
"""For recorded logs. Odometry is more accurate than nav2 assumes, as in mapping: standard deviations of 4° and 0.15 m
per metre, of 0.15 rad and 0.07 m per radian. The outlier weight z_rand is high, as buildings change after mapping."""

GLOBAL_PARAMETERS = AmclParameters(alpha1=0.1, alpha2=0.1, alpha3=0.1, alpha4=0.1)
"""For a global start on a recorded log. More motion noise than in `LOG_PARAMETERS` keeps particles around the true pose
until a single mode remains."""
