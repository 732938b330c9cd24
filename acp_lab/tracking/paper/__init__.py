"""The paper's own path, in modules that can be run, compared and taught one by one."""
