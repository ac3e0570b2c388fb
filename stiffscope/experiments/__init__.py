"""Virtual experiments on the parts of a robot, and the robot assembled from them."""
