"""Why a fit cannot be started."""

from apexcal.documents.errors import InputError


class SolveError(InputError):
    """A request or data that cannot be fitted; carries `code`, `message` and `hint`.

    Codes: too_few_pairs, non_finite, bad_shape, bounds_inside_out, unknown_parameter, unknown_bounds_preset,
    bad_schedule, bad_prior, bad_folds, bad_document, bad_covariances,
    no_covariances, and those of GeometryError
    (unknown_model, unknown_search_form, bad_transform, ...).
    """
