"""Virtual-joint model of a robot: kinematics, stiffness, gravity, vibration and mobility."""
