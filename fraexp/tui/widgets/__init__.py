"""The widgets of the screens: tables, forms and inputs."""
