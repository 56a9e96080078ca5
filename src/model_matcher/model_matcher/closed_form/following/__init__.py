"""An object followed through recorded pictures: the command, its pictures, tables and film."""
