"""One module per comparison; see `crosscheck/README.md` for what a check provides."""
