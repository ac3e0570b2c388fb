"""Effects that a robot may have and its model lack: a module each, found by `vocabulary`."""
