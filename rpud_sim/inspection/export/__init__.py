"""The tables of a bag as files for other programs: Parquet, CSV, NumPy."""
