"""Names under which effect files of version 0.1 know the catalogue's interface (calibration.effects.api)."""

from calibration.effects.api import Effect, Forms, Parameter, Setting

__all__ = ["Effect", "Forms", "Parameter", "Setting"]
