"""One module per subcommand of ``apexcal``; each holds a function of the same name."""
