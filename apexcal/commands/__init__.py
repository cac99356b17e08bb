"""The subcommands of ``apexcal``: a function each; :data:`apexcal.cli.COMMANDS` names its module."""
