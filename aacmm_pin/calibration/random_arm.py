"""A virtual arm: its geometry drawn from what its file states."""

from __future__ import annotations

import numpy as np

from aacmm_pin.accuracy.parameter_draws import parameter_errors
from aacmm_pin.arm import Arm
from aacmm_pin.calibration.calibrated_arm import moved_file
from aacmm_pin.calibration.parameter_vector import ParameterVector
from aacmm_pin.effects import ErrorModel, GivenModel
from aacmm_pin.errors import AacmmError


def perturbed_model(model: GivenModel, rng: np.random.Generator) -> ErrorModel:
    """A model with random parameter values, as a virtual arm.

    The draws are uniform within half-widths; normal for parameters without half-width, or in a
    covariance. The result has no uncertainties: its values are the truth.

    Args:
        model: the arm, or the arm with causes of error; at least one parameter needs an
            uncertainty.

    Raises:
        AacmmError: no parameter has an uncertainty, or an arm with a DH table comes from no file.
    """
    model = ErrorModel.of(model)
    errors = parameter_errors(model, rng, 1)[0]
    if not errors.any():
        raise AacmmError(
            f"{model.arm.name}: no parameter has an uncertainty; expected half-widths for a random "
            "geometry. State half-widths in the arm file, or with --urdf by "
            "--translation-half-width-mm and --rotation-half-width"
        )
    arm = model.arm
    of_arm, of_effects = np.split(errors, [len(arm.parameters)])
    vector = ParameterVector(arm, model.effects)
    effects = vector.at(vector.values + of_effects)
    if arm.dh is None:
        return ErrorModel(arm.with_placements(of_arm.reshape(-1, 6), None, exact=True), effects)
    names = [parameter.name for parameter in arm.parameters]
    file = moved_file(arm, dict(zip(names, of_arm.tolist(), strict=True)))
    rows = [row.model_copy(update={"uncertainty": None}) for row in file.joints]
    source = f"drawn within the uncertainties of {arm.source or arm.name}"
    update = {"joints": rows, "covariance": None, "source": source}
    return ErrorModel(Arm.from_file(file.model_copy(update=update)), effects)
