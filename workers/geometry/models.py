"""The camera models and search forms of the documents, and their numbers in the compiled kernels."""

from typing import Final

from apexcal.documents.camera_models import (
    DEFAULT_MODELS,
    EXTRINSICS,
    INTRINSICS,
    MODELS,
    SEARCH_FORMS,
    ModelName,
    SearchForm,
    parameter_names,
    parse_model,
    parse_search_form,
)

__all__ = [
    "DEFAULT_MODELS",
    "EXTRINSICS",
    "FORM_ID",
    "INTRINSICS",
    "MODELS",
    "SEARCH_FORMS",
    "ModelName",
    "SearchForm",
    "parameter_names",
    "parse_model",
    "parse_search_form",
]

FORM_ID: Final[dict[SearchForm, int]] = {name: index for index, name in enumerate(SEARCH_FORMS)}
