"""Metrics, references and reports: what a model costs in time and in truth."""
