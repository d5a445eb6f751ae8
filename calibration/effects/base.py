"""The catalogue's interface under the names of version 0.1, for effect files of users.

New code imports `calibration.effects.api`. The attributes that these files use on the objects handed to them are kept
there, each beside the attribute that replaced it (`former_name`).
"""

from calibration.effects.api import BasisSet as Form
from calibration.effects.api import BasisSets as Forms
from calibration.effects.api import Curve, Effect, Tangent, strongest_onset
from calibration.effects.api import EffectInputs as Setting
from calibration.effects.api import EffectParameter as Parameter
from calibration.effects.api import geometric_series as ladder
from calibration.effects.api import varies as varied

__all__ = [
    "Curve",
    "Effect",
    "Form",
    "Forms",
    "Parameter",
    "Setting",
    "Tangent",
    "ladder",
    "strongest_onset",
    "varied",
]
