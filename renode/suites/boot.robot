*** Settings ***
Documentation     Boot: clock tree, identity of the board, no warnings in the log.
Library           ForceBoard.py

*** Test Cases ***
Clock Tree Agrees With The Board's Report
    Power Up Board
    Advance    300
    ${hello}=    Connect
    Should Be Equal As Integers    ${hello}[core_hz]    400000000
    ${core}=    Number    rcc CoreHz
    Should Be Equal As Integers    ${core}    400000000
    ${bus}=    Number    rcc AhbHz
    Should Be Equal As Integers    ${bus}    200000000
    ${timer}=    Number    rcc Timer1Hz
    Should Be Equal As Integers    ${timer}    200000000
    ${baud}=    Number    usart3 BaudRate
    Should Be Equal As Integers    ${baud}    2000000

Outputs Stand At Zero From The First Instruction
    Power Up Board
    Output Should Be Zero
    Advance    2
    Output Should Be Zero
    Advance    500
    Output Should Be Zero

Power On Is Reported As Power On
    Power Up Board
    Advance    300
    ${hello}=    Connect
    # PORRSTF
    Should Be True    ${hello}[reset_flags] & (1 << 23)
    Should Be Equal    ${hello}[crash_record]    ${None}

Each Start Tells What Holds The Reset Line Of The DACs
    Power Up Board
    Advance    300
    ${hello}=    Connect
    Should Be Equal    ${hello}[dac_reset_pull]    Down
    # Without its resistor it follows the controller's own.
    Reset Emulation
    Power Up Board
    Execute Command    gpioPortF BoardDown 0
    Advance    300
    ${hello}=    Connect
    Should Be Equal    ${hello}[dac_reset_pull]    None
    # The resistor goes to 3.3 V.
    Reset Emulation
    Power Up Board
    Execute Command    gpioPortF BoardDown 0
    Execute Command    gpioPortF BoardUp 0xD000
    Advance    300
    ${hello}=    Connect
    Should Be Equal    ${hello}[dac_reset_pull]    Up

Time Of The Board Is Time
    Power Up Board
    Advance    300
    Connect
    ${first}=    Status
    Advance    1000
    ${second}=    Status
    ${passed}=    Evaluate    $second['t_us'] - $first['t_us']
    Should Be True    abs(${passed} - 1000000) < 3000

Alive Line Toggles
    Power Up Board
    # The line stands still until a configuration is in force.
    Advance    300
    Connect
    Bring Up Units
    Advance    1000
    ${hertz}=    Number    plc AliveHz
    Should Be True    abs(${hertz} - 500) < 5

No Register Goes Unhandled
    Create Log Tester    0
    Power Up Board
    Advance    500
    Connect
    Bring Up Units
    # The core's own models: Renode's NVIC has no instruction cache to invalidate (ICIALLU).
    Should Not Be In Log    ^(?!.*nvic: Unhandled write to offset 0xF50).*([Uu]nhandled|non existing)    treatAsRegex=True
