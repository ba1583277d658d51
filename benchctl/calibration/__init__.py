"""From a recording to coefficients with uncertainties: reduction, two stages, joint fit, errors, coefficients.json."""
