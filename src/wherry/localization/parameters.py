"""The parameters of Monte Carlo localization, with the names and defaults of nav2's amcl."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wherry.errors import InputError
from wherry.space.pose import Pose

ROBOT_MODELS = ("differential", "omnidirectional")
LASER_MODELS = ("likelihood_field", "likelihood_field_prob", "beam")
MOST_PARTICLES = 10_000_000  # a gigabyte
AT_ORIGIN = Pose()


@dataclass(frozen=True, slots=True)
class AmclParameters:
    """How the filter works. The defaults are nav2's; fields under "wherry's own" have no counterpart there.

    Attributes:
        alpha1: Odometry's rotation noise from rotation.
        alpha2: Odometry's rotation noise from translation.
        alpha3: Odometry's translation noise from translation.
        alpha4: Odometry's translation noise from rotation.
        alpha5: Odometry's sideways noise from translation, omnidirectional robots only.
        robot_model_type: One of ROBOT_MODELS, the keys of `motion.MOTION_MODELS`.
        laser_model_type: One of LASER_MODELS, the keys of `sensor.SENSOR_MODELS`.
        max_beams: Evenly spaced beams of a scan that are weighed.
        laser_min_range: m, shorter readings are not used; below 0 the scan's own limit holds.
        laser_max_range: m, longer readings are not used; the scan's own limit holds where it is shorter.
        laser_likelihood_max_dist: m, the likelihood field's distances are cut off here.
        z_hit: Share of readings that the map explains.
        z_short: Share of readings cut short by something unmapped (beam model).
        z_max: Share of readings that miss everything (beam model).
        z_rand: Share of readings that mean nothing.
        sigma_hit: σ, m, of readings that the map explains.
        lambda_short: λ, 1/m, how quickly readings that are cut short get rarer with distance (beam model).
        beam_skip_distance: m, a beam agrees with a particle when its end is this near to an obstacle.
        beam_skip_threshold: A beam is skipped if a smaller share of the particles agrees with it.
        beam_skip_error_threshold: Skipping is given up when a larger share of the beams would be skipped.
        min_particles: Fewest particles.
        max_particles: Most particles.
        pf_err: ε, bound on the distance between the particles' distribution and the true one (KLD sampling).
        pf_z: Upper standard normal quantile of the probability that ``pf_err`` holds (KLD sampling).
        resample_interval: Updates from one resampling to the next.
        selective_resampling: Whether to resample only when fewer than half of the particles carry the weight.
        update_min_d: m, the filter waits until the robot has moved so far,
        update_min_a: or turned so far, rad.
        recovery_alpha_slow: Decay of the slow average of the likelihood; 0 turns random particles off.
        recovery_alpha_fast: Decay of the fast average.
        set_initial_pose: Whether ``initial_pose`` is where the robot starts.
        initial_pose: Where it starts, map frame.
        initial_covariance: [3] variances m², m², rad² of the initial pose.

    Beyond amcl:
        independent_beams: How many independent readings the weighed beams are worth, since neighbours err alike.
        least_effective: Share of the particles that a scan leaves alive at least: a scan that would leave fewer counts
            for less. Without it a belief in several places is narrowed down to one before the evidence is in.
        refine: Whether the particles' mean is matched to the map before it is reported.
        refine_sigma: σ, m, of the matched readings around the map's obstacles.
        robot_radius: m, readings that end so near to base_link are the robot's own load, and are not used.
        turn_slip: m/rad, σ of how far a turn moves a differential robot's base_link sideways: the point that the
            odometry is for is not quite the one about which it turns.
        max_odometry_speed: m/s, a faster change of the odometry's pose is a jump, which is not believed.
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
    initial_pose: Pose = AT_ORIGIN
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
            InputError: A value cannot work.
        """
        for name, holds, reason in self._checks():
            if not holds:
                raise InputError("amcl parameters", name, f"{getattr(self, name)!r} {reason}")

    def _checks(self) -> list[tuple[str, bool, str]]:
        """Every field with whether it can work, and what it must be."""
        shares = ["z_hit", "z_short", "z_max", "z_rand", "beam_skip_threshold", "beam_skip_error_threshold"]
        shares += ["recovery_alpha_slow", "recovery_alpha_fast", "least_effective"]
        noises = ["alpha1", "alpha2", "alpha3", "alpha4", "alpha5", "update_min_d", "update_min_a", "lambda_short"]
        noises += ["robot_radius", "turn_slip"]
        sizes = ["sigma_hit", "laser_likelihood_max_dist", "laser_max_range", "pf_err", "pf_z", "refine_sigma"]
        sizes += ["beam_skip_distance", "max_odometry_speed", "independent_beams"]
        return [
            *((name, 0.0 <= getattr(self, name) <= 1.0, "is not between 0 and 1") for name in shares),
            *((name, 0.0 <= getattr(self, name) < math.inf, "must not be negative") for name in noises),
            *((name, 0.0 < getattr(self, name) < math.inf, "must be positive") for name in sizes),
            ("z_hit", self.z_hit > 0.0, "must be positive"),
            ("z_rand", self.z_rand > 0.0, "must be positive, or one odd reading would rule every pose out"),
            ("max_beams", self.max_beams >= 2, "is fewer than 2"),
            ("min_particles", self.min_particles >= 1, "is fewer than 1"),
            ("max_particles", self.max_particles >= self.min_particles, "is below min_particles"),
            ("max_particles", self.max_particles <= MOST_PARTICLES, f"is more than {MOST_PARTICLES:,}"),
            ("resample_interval", self.resample_interval >= 1, "is fewer than 1"),
            ("robot_model_type", self.robot_model_type in ROBOT_MODELS, f"is none of {', '.join(ROBOT_MODELS)}"),
            ("laser_model_type", self.laser_model_type in LASER_MODELS, f"is none of {', '.join(LASER_MODELS)}"),
            ("initial_pose", all(map(math.isfinite, self.initial_pose.as_array())), "is not finite"),
            ("initial_covariance", all(0.0 <= v < math.inf for v in self.initial_covariance), "must not be negative"),
        ]


PRECISE = AmclParameters(
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
"""For a robot with good odometry and lidar on its own map: 1 cm where the defaults give 2 to 3, since what is not on
the map and stands near its walls no longer pulls the belief."""
