"""The Gymnasium environments that follow a reference: task, actuation, sensors, drawing."""
