"""The paper reproduced: every figure and number, with intervals, under every reading."""
