"""Campaigns: scenarios, parameters and seeds against a system under test, collected by pytest."""
