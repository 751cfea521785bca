"""The paper's statistics without a posterior."""
