"""What the network of edge profiles is trained on, and how: see `data_recipes.edge_profiles`."""
