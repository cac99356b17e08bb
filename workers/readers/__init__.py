"""Every file format in; one Recording interface out."""
