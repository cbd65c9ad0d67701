"""What every node is made of: its life, worker, parameters, topics and reports."""
