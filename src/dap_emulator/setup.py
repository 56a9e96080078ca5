import os
from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'dap_emulator'
# Data lives inside the Python package (importlib.resources finds it there) and is installed to
# share/ as well, where ROS tools look. Every folder of the package that holds no Python is data.
DATA = ['config', 'programs']


def share(folder):
    files = sorted(f for f in glob(os.path.join(PACKAGE, folder, '*')) if os.path.isfile(f))
    return (os.path.join('share', PACKAGE, folder), files)


setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', '**/*.lark'] + [folder + '/*' for folder in DATA]},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + PACKAGE]),
        ('share/' + PACKAGE, ['package.xml']),
    ]
    + [share(folder) for folder in DATA],
    install_requires=['setuptools'],
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='The maintainers',
    maintainer_email='maintainers@example.com',
    description='Emulator of the AMT DAP array processor',
    license='Apache-2.0',
    entry_points={
        'console_scripts': ['emulator_node = graph_executables:emulator_node', 'dap = dap_emulator.dap_cli:main']
    },
)
