"""One module per comparison; see `tools/crosscheck/README.md` for what a check provides."""
