"""The service's resources as groups of methods; :class:`apexcal.client.Client` holds one of each."""
