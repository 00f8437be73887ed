"""TOML, its checks, formulas, the scene and its schema."""
