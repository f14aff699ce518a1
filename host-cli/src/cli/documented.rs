//! Every command line of `forcectl` in README.md and docs/ is one that the parser takes.
