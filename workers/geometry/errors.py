"""The errors of the pure rooms; each says what is wrong and what to do about it."""

from apexcal.documents.errors import DocumentError


class InputError(DocumentError):
    """Input that cannot be worked on."""


class GeometryError(InputError):
    """A rotation, a transform or a camera model that is not one."""
