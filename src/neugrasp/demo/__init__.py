"""The four bundled scenes (`bundled`) and the command that predicts them."""
