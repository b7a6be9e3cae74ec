"""Export of the tables of a bag to files for other programs: Parquet, CSV, NumPy."""
