"""The four bundled scenes and the command that predicts them. See docs/architecture.md."""
