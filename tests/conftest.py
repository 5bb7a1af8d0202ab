"""What all tests share."""

pytest_plugins = ["plugins.skips"]
