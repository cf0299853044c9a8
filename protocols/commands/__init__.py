"""One file a command: `add_arguments(parser)` and `main(args) -> int | None`, imported only when the command is
called."""
