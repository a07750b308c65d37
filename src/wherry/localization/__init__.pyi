from .agreement import ScanAgreement
from .amcl import Amcl
from .ekf import EkfLocalization
from .estimation import PoseEstimate
from .grid_markov import GridMarkov
from .initialization import PoseMode
from .localizer import Localization, Localizer
from .lost import LostDetector
from .parameter_files import LoadedParameters, load_parameters
from .parameters import GLOBAL_PARAMETERS, LOG_PARAMETERS, PRECISE_PARAMETERS, AmclParameters
from .relocalization import Hypothesis, Relocalization, Relocalizer

__all__ = [
    "GLOBAL_PARAMETERS",
    "LOG_PARAMETERS",
    "PRECISE_PARAMETERS",
    "Amcl",
    "AmclParameters",
    "EkfLocalization",
    "GridMarkov",
    "Hypothesis",
    "LoadedParameters",
    "Localization",
    "Localizer",
    "LostDetector",
    "PoseEstimate",
    "PoseMode",
    "Relocalization",
    "Relocalizer",
    "ScanAgreement",
    "load_parameters",
]
