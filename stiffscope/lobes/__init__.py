"""Regenerative chatter: depths of cut that stay stable."""
