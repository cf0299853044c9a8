"""What goes out of a drone and comes in: DroneCAN and MAVLink messages, and the sockets and ports below them."""
