"""What the paper's experiment is made of: settings, data sets, policies, and suspicions about data."""
