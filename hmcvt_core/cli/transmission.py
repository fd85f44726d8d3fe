import click

group = click.Group("transmission")
