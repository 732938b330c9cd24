"""The bodies of the `acp-lab` commands, one module each; acp_lab.cli declares and loads them."""
