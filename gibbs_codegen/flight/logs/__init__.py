"""Flights as logs of ROS 2 and PX4, and logs as flights."""
