"""The subcommands of this area."""
